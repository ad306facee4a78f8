"""Whether the numbers of a report bear out what Kim et al. claim."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from .experiments import CASES, FRAMES, VARIANTS

FRAMES_PER_SECOND = 350  # "over", on a GTX 1070
GPU_OVER_CPU = 1.6
DEEP = 1e-3  # m: a triangle this deep shows in a picture
THROUGH = 1e-2  # m: a triangle this deep counts as penetration by a moving sphere
FOLDED = 90.0  # degrees between the normals of neighbouring cells
WRAPPED = 10  # points that touch a sphere which the cloth wraps
EQUAL = 0.03  # rates that differ by less are equal within the noise


def format_number(value: Any, digits: int = 3) -> str:
    """Format `value`, or each of a list, with `digits` significant digits. Values below 1e-9 are
    rounding errors and print as 0.
    """
    if isinstance(value, list):
        return " / ".join(format_number(entry, digits) for entry in value)
    if isinstance(value, str | int):
        return str(value)
    if abs(value) < 1e-9:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    return f"{float(f'{value:.{digits - 1}e}'):,.10f}".rstrip("0").rstrip(".")


class Finding(NamedTuple):
    """A claim in a few words, the rule that judges it, the verdict ("yes", "no", "in part", "not
    measured"), our numbers, and a sentence on them.
    """

    claim: str
    criterion: str
    verdict: str
    printed: str
    corrected: str
    sentence: str = ""


def judge_claims(experiments: dict[str, Any]) -> dict[str, list[Finding]]:
    """Judge each claim; the rows are in lists by experiment."""
    judges = {
        "1": _judge_static_sphere,
        "2": _judge_moving_sphere,
        "3": _judge_frame_rates,
        "4": _judge_speedup,
        "5": _judge_limits,
    }
    return {key: judge(experiments[key]) for key, judge in judges.items() if key in experiments}


def list_verdicts(experiments: dict[str, Any]) -> list[str]:
    """Write a line for each claim: whether it held, and the claim."""
    rows = [finding for rows in judge_claims(experiments).values() for finding in rows]
    return [f"{finding.verdict + ':':13} {finding.claim}" for finding in rows]


def _depths_in_mm(depths: Iterable[float]) -> str:
    return format_number([1e3 * depth for depth in depths], 2) + " mm"


def _methods_differ(first: list[float], second: list[float]) -> bool:
    """Tell whether method 1 penetrates at every frame and method 2 at none."""
    return bool(first and second) and min(first) > DEEP > max(second)


def _values_of_both_methods(values: dict[str, Any], variant: str) -> list[Any]:
    """Return the values of method 1 and method 2."""
    return [values[f"method {k}, {variant}"] for k in (1, 2)]


def _judge_static_sphere(entry: dict[str, Any]) -> list[Finding]:
    claim = "static sphere: method 1 penetrates at the three frames, method 2 does not"
    depths = {
        name: [cell["triangles"] for cell in entry["cells"] if cell["case"] == name]
        for name in CASES
    }
    pairs = [_values_of_both_methods(depths, variant) for variant in VARIANTS]
    printed, corrected = (
        f"method 1: {_depths_in_mm(a)}; method 2: {_depths_in_mm(b)}" for a, b in pairs
    )
    coarse = [row["triangles"] for row in entry["study"][-2:]]  # steps as long as a frame
    deepest = [_depths_in_mm([max(depth, default=0.0)]) for depth in pairs[0]]
    sentence = (
        f"As printed, triangles are up to {deepest[0]} deep with method 1 and {deepest[1]} "
        "with method 2, in cells whose corners lie on the sphere"
    )
    verdict = "yes" if _methods_differ(*pairs[0]) else "no"
    if verdict == "no" and len(coarse) == 2 and _methods_differ(*coarse):
        verdict = "in part"
        first, second = map(_depths_in_mm, coarse)
        printed += f"; with steps as long as a frame: {first}; {second}"
        sentence += "; the paper's difference appears with steps as long as a frame"
    criterion = (
        f"triangles deeper than {_depths_in_mm([DEEP])} at each frame with method 1, at none "
        "with method 2; in part: with steps as long as a frame alone"
    )
    ray = [max(depth, default=0.0) for _, depth in pairs]
    offset = Finding(
        "static sphere: with method 2 and the offset nothing penetrates",
        f"no triangle deeper than {_depths_in_mm([DEEP])} at the three frames",
        "yes" if ray[0] <= DEEP else "no",
        *(f"{_depths_in_mm([depth])} deep" for depth in ray),
    )
    return [Finding(claim, criterion, verdict, printed, corrected, sentence), offset]


def _judge_moving_sphere(entry: dict[str, Any]) -> list[Finding]:
    # The last cell of each case
    cells = dict.fromkeys(CASES) | {cell["case"]: cell for cell in entry["cells"]}
    printed, corrected = (
        "; ".join(
            f"method {k}: {cell['points_passed']} points passed, triangles to "
            f"{_depths_in_mm([cell['triangles_so_far']])} deep"
            for k, cell in enumerate(_values_of_both_methods(cells, variant), 1)
            if cell
        )
        for variant in VARIANTS
    )
    first, second = _values_of_both_methods(cells, VARIANTS[0])
    verdict = "no"
    if _goes_through(first):
        if not _goes_through(second):
            verdict = "yes"
        # Fewer points and less depth with method 2 than with method 1 bear the claim out in part.
        elif (
            second["points_passed"] <= first["points_passed"]
            and second["triangles_so_far"] < first["triangles_so_far"]
        ):
            verdict = "in part"
    sentence = f"As printed, {printed}. Corrected, {corrected}"
    criterion = (
        f"points pass, or triangles are deeper than {_depths_in_mm([THROUGH])}, with method 1 "
        "alone; in part: with method 2 too, but less"
    )
    claim = "moving sphere: it penetrates with method 1, not with method 2"
    return [
        Finding(claim, criterion, verdict, printed, corrected, sentence),
        _judge_edge(entry),
        _judge_slow_cloth(entry),
    ]


def _goes_through(cell: dict[str, Any] | None) -> bool:
    """Tell whether the moving sphere goes through the cloth."""
    if cell is None:
        return False
    return bool(cell["points_passed"] or cell["triangles_so_far"] > THROUGH)


def _grade_claim(count: int, total: int) -> str:
    """Say whether a claim held, of which `count` of `total` parts held."""
    if count == 0:
        return "no"
    return "yes" if count == total else "in part"


def _judge_edge(entry: dict[str, Any]) -> Finding:
    """Judge the edge at the first contact with the moving sphere."""
    frame = FRAMES["2"][0]
    cells = dict.fromkeys(CASES) | {
        cell["case"]: cell for cell in entry["cells"] if cell["frame"] == frame
    }
    pairs = [_values_of_both_methods(cells, variant) for variant in VARIANTS]
    texts = (
        "; ".join(
            f"method {k}: {format_number(cell['sharpest_fold'])} degrees, "
            f"{cell['points_touching']} points touch"
            for k, cell in enumerate(pair, 1)
            if cell
        )
        for pair in pairs
    )
    first, second = pairs[0]
    folds = first is not None and first["sharpest_fold"] > FOLDED
    wraps = (
        second is not None
        and second["sharpest_fold"] <= FOLDED
        and second["points_touching"] >= WRAPPED
    )
    return Finding(
        f"moving sphere, frame {frame}: the edge folds with method 1, wraps it with method 2",
        f"neighbouring cells at more than {FOLDED:g} degrees with method 1 alone, and "
        f"{WRAPPED} points touch with method 2; in part: one of the two",
        _grade_claim(folds + wraps, 2),
        *texts,
    )


def _judge_slow_cloth(entry: dict[str, Any]) -> Finding:
    """Judge method 1 at the later contacts with the moving sphere, when the cloth is slow."""
    frames = FRAMES["2"][1:]
    depths = [
        [
            cell["points"]
            for cell in entry["cells"]
            if cell["case"] == f"method 1, {variant}" and cell["frame"] in frames
        ]
        for variant in VARIANTS
    ]
    return Finding(
        "method 1 penetrates slow cloth",
        f"moving sphere, mass points deeper than {_depths_in_mm([DEEP])} at frames "
        f"{' and '.join(map(str, frames))}; in part: at one of them",
        _grade_claim(sum(depth > DEEP for depth in depths[0]), len(frames)),
        *map(_depths_in_mm, depths),
    )


def _judge_frame_rates(entry: dict[str, Any]) -> list[Finding]:
    rates = {row["case"]: row["frames_per_second"] for row in entry["rows"]}
    pairs = [_values_of_both_methods(rates, variant) for variant in VARIANTS]
    printed, corrected = (
        f"{format_number(a)} frames/s with method 1, {format_number(b)} with method 2"
        for a, b in pairs
    )
    verdict = _grade_claim(sum(b < a * (1 - EQUAL) for a, b in pairs), len(pairs))
    steps = entry["frame_steps"]
    least = min(rates.values())
    quick = _grade_claim((least > FRAMES_PER_SECOND) + (least * steps > FRAMES_PER_SECOND), 2)
    texts = [
        f"{format_number(min(pair))} frames/s of {steps} steps; "
        f"{format_number(min(pair) * steps)} of one"
        for pair in pairs
    ]
    sentence = (
        f"{'Reproduced' if verdict == 'yes' else 'Not reproduced'}: as printed, {printed}; "
        f"corrected, {corrected}. If a frame were a single step of 5 us, as Table 2 reads, "
        f"these would be {steps} times as many"
    )
    quick_claim = f"both methods show more than {FRAMES_PER_SECOND} frames/s"
    return [
        Finding(
            "method 2 is somewhat slower than method 1",
            f"slower by more than {EQUAL:.0%}; in part: as printed or corrected alone",
            verdict,
            printed,
            corrected,
            sentence,
        ),
        Finding(
            quick_claim,
            f"the slowest has more; in part: with a frame of a single step of 5 us ({steps} here)",
            quick,
            *texts,
        ),
    ]


def _judge_speedup(entry: dict[str, Any]) -> list[Finding]:
    claim = "method 2 on the GPU is 60 % faster than on the CPU"
    missing = entry["missing"]
    criterion = f"the fastest shader takes {GPU_OVER_CPU} times the steps of the fastest core"
    first_claim = "the first measurement on the GPU is slower, since buffers are made in it"
    first_criterion = f"slower than the median of its runs by more than {EQUAL:.0%}"
    rates = {row["case"]: row["times_the_first"] for row in entry["rows"]}
    core = max((name for name in rates if name.startswith("core")), key=rates.__getitem__)
    sentence = (
        f"The fastest on the CPU ({core}) takes {format_number(rates[core])} times the steps of "
        "the scalar reference; "
    )
    shader = max((rate for name, rate in rates.items() if name.startswith("shader")), default=0.0)
    if not shader:
        absent = ("not measured", missing, missing)
        return [
            Finding(claim, criterion, *absent, sentence + f"the GPU was not measured: {missing}"),
            Finding(first_claim, first_criterion, *absent),
        ]
    text = f"the shader takes {format_number(shader / rates[core])} times the steps of the core"
    faster = "yes" if shader >= GPU_OVER_CPU * rates[core] else "no"
    row = max(
        (row for row in entry["rows"] if row["case"].startswith("shader")),
        key=lambda row: row["times_the_first"],
    )
    part = row["each"][0] / row["steps_per_second"]
    return [
        Finding(claim, criterion, faster, "not timed", text, sentence + text),
        Finding(
            first_claim,
            first_criterion,
            "yes" if part < 1 - EQUAL else "no",
            "not timed",
            f"the first run takes {format_number(part)} times the steps/s of the median",
        ),
    ]


def _judge_limits(entry: dict[str, Any]) -> list[Finding]:
    """Judge the limits that the paper names, by the spheres of experiment 5."""
    rows = {(row["sphere"], row["case"]): row for row in entry["rows"]}
    counts = [
        [row["points_passed"] for row in (rows.get(("fast", name)) for name in pair) if row]
        for pair in ([f"method {k}, {variant}" for k in (1, 2)] for variant in VARIANTS)
    ]
    texts = (
        "; ".join(f"method {k}: {count} points" for k, count in enumerate(pair, 1))
        for pair in counts
    )
    through = sum(count > 0 for count in counts[0])
    return [
        Finding(
            "a fast sphere can pass between two steps",
            "points pass through the fast sphere with both methods; in part: with one",
            _grade_claim(through, len(counts[0])),
            *texts,
        )
    ]


def summarize_experiment(key: str, entry: dict[str, Any]) -> str:
    """Write a sentence or two on what the experiment gave here."""
    if key != "5":
        return judge_claims({key: entry})[key][0].sentence + "."
    leaks = {row["case"] for row in entry["rows"] if row["points_passed"] or row["failure"]}
    tight = dict.fromkeys(row["case"] for row in entry["rows"] if row["case"] not in leaks)
    if not tight:
        return "Mass points pass with every response."
    return f"No mass point passes with: {'; '.join(tight)}."
