"""Whether the numbers of a report bear out what Kim et al. claim; their claims in full:
docs/reproduction.md.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from .experiments import CASES, VARIANTS

FRAMES_PER_SECOND = 350  # "over", on a GTX 1070
GPU_OVER_CPU = 1.6
DEEP = 1e-3  # m: a triangle this deep shows in a picture
EQUAL = 0.03  # rates that differ by less are equal within the noise


def number(value: Any, digits: int = 3) -> str:
    """`value`, or each of a list, with `digits` significant digits. Values below 1e-9 are rounding
    errors and print as 0.
    """
    if isinstance(value, list):
        return " / ".join(number(one, digits) for one in value)
    if isinstance(value, str | int):
        return str(value)
    if abs(value) < 1e-9:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    return f"{float(f'{value:.{digits - 1}e}'):,.10f}".rstrip("0").rstrip(".")


class Finding(NamedTuple):
    """A claim in a few words, whether it held ("yes", "no", "in part", "not measured"), our
    numbers, and their sentence.
    """

    claim: str
    held: str
    printed: str
    corrected: str
    here: str


def findings(experiments: dict[str, Any]) -> dict[str, list[Finding]]:
    """By experiment, a row for each claim."""
    judges = {"1": _static, "2": _moving, "3": _rates, "4": _gpu}
    return {key: judge(experiments[key]) for key, judge in judges.items() if key in experiments}


def _mm(depths: Iterable[float]) -> str:
    return number([1e3 * depth for depth in depths], 2) + " mm"


def _differ(one: list[float], two: list[float]) -> bool:
    """Whether method 1 penetrates at every frame and method 2 at none."""
    return bool(one and two) and min(one) > DEEP > max(two)


def _both(values: dict[str, Any], variant: str) -> list[Any]:
    return [values[f"method {k}, {variant}"] for k in (1, 2)]


def _static(entry: dict[str, Any]) -> list[Finding]:
    claim = "static sphere: method 1 penetrates at the three frames, method 2 does not"
    depths = {
        name: [cell["triangles"] for cell in entry["cells"] if cell["case"] == name]
        for name in CASES
    }
    pairs = [_both(depths, variant) for variant in VARIANTS]
    printed, corrected = (f"method 1: {_mm(one)}; method 2: {_mm(two)}" for one, two in pairs)
    coarse = [row["triangles"] for row in entry["study"][-2:]]  # one step a frame
    deepest = [_mm([max(depth, default=0.0)]) for depth in pairs[0]]
    here = (
        f"As printed, triangles are up to {deepest[0]} deep with method 1 and {deepest[1]} "
        "with method 2, in cells whose "
    )
    here += "corners lie on the sphere"
    held = "yes" if _differ(*pairs[0]) else "no"
    if held == "no" and len(coarse) == 2 and _differ(*coarse):
        held = "in part"
        printed += f"; with one step a frame: {_mm(coarse[0])}; {_mm(coarse[1])}"
        here += "; the paper's difference appears with one step a frame"
    return [Finding(claim, held, printed, corrected, here)]


def _moving(entry: dict[str, Any]) -> list[Finding]:
    cells = dict.fromkeys(CASES) | {
        cell["case"]: cell for cell in entry["cells"]
    }  # the last of each
    printed, corrected = (
        "; ".join(
            f"method {k}: {cell['points_passed']} points passed, triangles to "
            f"{_mm([cell['triangles_so_far']])} deep"
            for k, cell in enumerate(_both(cells, variant), 1)
            if cell
        )
        for variant in VARIANTS
    )
    passes = [
        bool(c and (c["points_passed"] or c["triangles_so_far"] > 10 * DEEP))
        for c in _both(cells, VARIANTS[0])
    ]
    held = "yes" if passes == [True, False] else "in part" if passes[0] else "no"
    here = f"As printed, {printed}. Corrected, {corrected}"
    return [
        Finding(
            "moving sphere: it penetrates with method 1, not with method 2",
            held,
            printed,
            corrected,
            here,
        )
    ]


def _rates(entry: dict[str, Any]) -> list[Finding]:
    rates = {row["case"]: row["frames_per_second"] for row in entry["rows"]}
    pairs = [_both(rates, variant) for variant in VARIANTS]
    printed, corrected = (
        f"{number(one)} frames/s with method 1, {number(two)} with method 2" for one, two in pairs
    )
    slower = [two < one * (1 - EQUAL) for one, two in pairs]
    held = "yes" if all(slower) else "in part" if any(slower) else "no"
    steps, least = entry["frame_steps"], min(rates.values())
    quick = (
        "yes"
        if least > FRAMES_PER_SECOND
        else "in part"
        if least * steps > FRAMES_PER_SECOND
        else "no"
    )
    shown = [
        f"{number(min(pair))} frames/s of {steps} steps; {number(min(pair) * steps)} of one"
        for pair in pairs
    ]
    here = (
        f"{'Reproduced' if held == 'yes' else 'Not reproduced'}: as printed, {printed}; "
        f"corrected, {corrected}. "
    )
    here += f"With one step a frame, as Table 2 reads, these are {steps} times as many"
    quick_claim = f"both methods show more than {FRAMES_PER_SECOND} frames/s"
    return [
        Finding("method 2 is somewhat slower than method 1", held, printed, corrected, here),
        Finding(quick_claim, quick, shown[0], shown[1], ""),
    ]


def _gpu(entry: dict[str, Any]) -> list[Finding]:
    claim, missing = "method 2 on the GPU is 60 % faster than on the CPU", entry["missing"]
    rates = {row["case"]: row["times_the_first"] for row in entry["rows"]}
    core = max((name for name in rates if name.startswith("core")), key=rates.__getitem__)
    here = (
        f"The fastest on the CPU ({core}) takes {number(rates[core])} times the steps of the "
        "scalar reference; "
    )
    shader = max((rate for name, rate in rates.items() if name.startswith("shader")), default=0.0)
    if not shader:
        return [
            Finding(
                claim,
                "not measured",
                missing,
                missing,
                here + f"the GPU was not measured: {missing}",
            )
        ]
    text = f"the shader takes {number(shader / rates[core])} times the steps of the core"
    return [
        Finding(
            claim,
            "yes" if shader >= GPU_OVER_CPU * rates[core] else "no",
            "not timed",
            text,
            here + text,
        )
    ]


def here(key: str, entry: dict[str, Any]) -> str:
    """A sentence or two on what the experiment gave here."""
    if key != "5":
        return findings({key: entry})[key][0].here + "."
    passed = {row["case"] for row in entry["rows"] if row["points_passed"] or row["failure"]}
    held = dict.fromkeys(row["case"] for row in entry["rows"] if row["case"] not in passed)
    return (
        f"No mass point passes with: {'; '.join(held)}."
        if held
        else "Mass points pass with every response."
    )
