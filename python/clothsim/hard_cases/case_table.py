"""The hard cases, run and as text."""

from __future__ import annotations

import math
from typing import Any

from ..base.progress import ProgressBar
from ..base.table import aligned
from .case import HardCase, HardCaseResult


def run_hard_cases(cases: dict[str, HardCase], progress: bool = False, **options: Any) -> list[dict[str, Any]]:
    """Every case in each of its precisions, as plain data."""
    runs = [(name, precision) for name, case in cases.items() for precision in case.precisions]
    results = []
    with ProgressBar(progress, total=len(runs), unit="run") as bar:
        for name, precision in runs:
            bar.say(name)
            result = cases[name].run(precision, **options)
            results.append(_as_data(name, cases[name], precision, result))
            bar.advance()
    return results


def _as_data(name: str, case: HardCase, precision: str, result: HardCaseResult) -> dict[str, Any]:
    return {
        "case": name,
        "precision": precision,
        "why": case.why,
        "expected": case.expected,
        "dt": case.dt,
        "steps": case.steps,
        "passed": result.passed,
        "wall_time": result.wall_time,
        "figures": [
            {"name": f.name, "value": f.value, "low": f.low, "high": f.high, "passed": f.passed} for f in result.figures
        ],
    }


def hard_case_table(results: list[dict[str, Any]]) -> str:
    """Each case with its expected outcome; below it a line per precision and figure."""
    lines, last = [], None
    for result in results:
        if result["case"] != last:
            last = result["case"]
            lines.append(f"{last}: {result['steps']:,} steps of {result['dt']:.3g} s")
            lines.append(f"    hard: {result['why']}")
            lines.append(f"    expected: {result['expected']}")
        rows = []
        for figure in result["figures"]:
            if figure["passed"] and figure["name"] == "UnstableError" and not figure["value"]:
                continue  # none expected, none raised
            mark = "ok" if figure["passed"] else "FAIL"
            value = f"{figure['name']} = {figure['value']:.3g}"
            rows.append((mark, result["precision"], value, _range(figure)))
        lines += [aligned((), rows, left=range(4), indent="  ")] if rows else []
    failed = sum(not result["passed"] for result in results)
    lines.append(f"{len(results) - failed} of {len(results)} runs as expected")
    return "\n".join(lines)


def _range(figure: dict[str, Any]) -> str:
    low, high = figure["low"], figure["high"]
    if low == high:
        return f"expected {low:g}"
    if low in (0, -math.inf):
        return f"at most {high:g}"
    return f"{low:g} to {high:g}"
