"""Stability for people: the map and the hard cases as tables, the map as a picture and a CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ..base.extras import needed
from ..base.progress import ProgressBar
from ..lab.hard_cases.case import HardCase, HardCaseResult
from .map import StabilityMap


def map_table(found: StabilityMap) -> str:
    """Time steps down, stiffnesses across; ``o`` stable, ``x`` not, and where prediction differs."""
    width = 9
    head = "dt [s] \\ K [N/m]"

    def row(name: str, cells: Iterable[str]) -> str:
        return f"{name:<16}" + "".join(f"{cell:>{width}}" for cell in cells)

    lines = [row(head, (f"{k:.2g}" for k in found.stiffness))]
    for j in np.argsort(found.dt)[::-1]:
        marks = ("o" if s else "x" for s in found.stable[:, j])
        agree = (m if s == p else m + "!" for m, s, p in zip(marks, found.stable[:, j], found.predicted[:, j]))
        lines.append(row(f"{found.dt[j]:.3e}", agree))
    lines.append(row("predicted limit", (f"{h:.2e}" for h in found.limit)))
    lines.append(row("guaranteed", (f"{h:.2e}" for h in found.guarantee)))
    differing = int((found.stable != found.predicted).sum())
    lines.append(
        f"o stable, x unstable over {found.steps} steps of {found.integrator} in {found.precision}; "
        f"! where the prediction differs: {differing} of {found.stable.size} cells"
    )
    return "\n".join(lines)


def write_csv(found: StabilityMap, path: Path) -> None:
    """One row a cell."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["stiffness", "dt", "stable", "predicted", "limit", "guarantee"])
        for i, k in enumerate(found.stiffness):
            for j, dt in enumerate(found.dt):
                cells = (int(found.stable[i, j]), int(found.predicted[i, j]))
                writer.writerow([float(k), float(dt), *cells, found.limit[i], found.guarantee[i]])


def need_matplotlib() -> None:
    """Raise an ImportError that names the extra, where matplotlib is missing."""
    needed("matplotlib", "a picture", "plot")


def draw_map(found: StabilityMap, path: Path) -> None:
    """Stable and unstable runs, the predicted line and the guaranteed one."""
    need_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    k, dt = np.meshgrid(found.stiffness, found.dt, indexing="ij")
    for mask, color, marker, label in (
        (found.stable, "tab:blue", "o", "stable"),
        (~found.stable, "tab:red", "x", "unstable"),
    ):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    order = np.argsort(found.stiffness)
    for values, style, label in (
        (found.limit, "-", "predicted limit"),
        (found.guarantee, "--", "guaranteed (max_stable_dt)"),
    ):
        if np.isfinite(values).any():
            axes.plot(found.stiffness[order], values[order], "k" + style, label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=f"{found.integrator}, {found.precision}: {found.steps} steps",
    )
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path)


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
        for figure in result["figures"]:
            if figure["passed"] and figure["name"] == "UnstableError" and not figure["value"]:
                continue  # none expected, none raised
            mark = "ok  " if figure["passed"] else "FAIL"
            value = f"{figure['name']} = {figure['value']:.3g}"
            lines.append(f"  {mark} {result['precision']:<6}  {value:<45} {_range(figure)}")
    failed = sum(not result["passed"] for result in results)
    lines.append(f"{len(results) - failed} of {len(results)} runs as expected")
    return "\n".join(lines)


def _range(figure: dict[str, Any]) -> str:
    low, high = figure["low"], figure["high"]
    if low == high:
        return f"expected {low:g}"
    if low in (0, -np.inf):
        return f"at most {high:g}"
    return f"{low:g} to {high:g}"
