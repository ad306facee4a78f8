"""What Kim et al. claim, in our words, and whether the numbers of a report bear it out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

FRAMES_PER_SECOND = 350  # "over", on a GTX 1070
GPU_OVER_CPU = 1.6
DEEP = 1e-3  # m: a triangle this deep shows in a picture
EQUAL = 0.03  # rates that differ by less are equal within the noise

CLAIMS = {
    "1": "Table 3, frames 150, 500 and 800: with method 1 the sphere penetrates the cloth's faces at all three, with "
    "method 2 at none.",
    "2": "Table 4, frames 200, 1300 and 3100 in the text (the printed table is headed 150, 500 and 800): the first, second "
    "and third contact. Frame 200, seen from the back: the edge folds with method 1 and wraps the sphere with method 2. "
    "Frames 1300 and 3100: the sphere penetrates the cloth with method 1, because the points are too slow to be moved out; "
    "not with method 2.",
    "3": "Figure 9, mean of every 200 frames, 10 runs: method 2 somewhat slower than method 1, both above 350 frames/s "
    "(GTX 1070).",
    "4": "Figure 10: method 2 on the GPU is 60 % faster than on the CPU (GTX 1070 against i5-4460), and its first "
    "measurement is slower because buffers are made in it.",
    "5": "This experiment is ours. The paper names as its limits that a fast sphere can pass between two steps and that "
    "method 1 penetrates slow cloth, without numbers.",
}


def number(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits, thousands separated; what is below 1e-9, which is rounding, is 0."""
    if abs(value) < 1e-9:
        return "0"
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    return f"{float(f'{value:.{digits - 1}e}'):,.10f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Finding:
    """A claim in a few words, whether it held ("yes", "no", "in part", "not measured"), and our numbers."""

    experiment: str
    claim: str
    held: str
    printed: str
    corrected: str


def findings(experiments: dict[str, Any]) -> list[Finding]:
    """A row for each claim whose experiment was run."""
    rows: list[Finding] = []
    for key, judge in (("1", _static), ("2", _moving), ("3", _rates), ("4", _gpu)):
        if key in experiments:
            rows += judge(experiments[key])
    return rows


def _depths(entry: dict[str, Any], method: int, variant: str) -> list[float]:
    return [c["penetration"]["triangles"] for c in entry["cells"] if (c["method"], c["variant"]) == (method, variant)]


def _millimetres(depths: Iterable[float]) -> str:
    return " / ".join(number(1e3 * d, 2) for d in depths) + " mm"


def _static(entry: dict[str, Any]) -> list[Finding]:
    one, two = (_depths(entry, k, "as printed") for k in (1, 2))
    held = bool(one and two) and min(one) > DEEP > max(two)
    texts = [
        f"method 1: {_millimetres(_depths(entry, 1, v))}; method 2: {_millimetres(_depths(entry, 2, v))}"
        for v in ("as printed", "corrected")
    ]
    claim = "static sphere: method 1 penetrates at the three frames, method 2 does not"
    return [Finding("1", claim, "yes" if held else "no", *texts)]


def _moving(entry: dict[str, Any]) -> list[Finding]:
    last = {(c["method"], c["variant"]): c for c in entry["cells"]}
    texts = []
    for variant in ("as printed", "corrected"):
        parts = [
            f"method {k}: {c['points_passed']} points passed, triangles to {number(1e3 * c['deepest_so_far'], 2)} mm"
            for k in (1, 2)
            if (c := last.get((k, variant)))
        ]
        texts.append("; ".join(parts) or "ended early")
    passes = [bool(c and (c["points_passed"] or c["deepest_so_far"] > 10 * DEEP)) for c in map(last.get, _PRINTED)]
    held = "yes" if passes == [True, False] else "in part" if passes[0] else "no"
    return [Finding("2", "moving sphere: it penetrates with method 1, not with method 2", held, *texts)]


_PRINTED = ((1, "as printed"), (2, "as printed"))


def _rates(entry: dict[str, Any]) -> list[Finding]:
    one, two = (r["frames_per_second"] for r in entry["rows"] if r["window"] == "all")
    ours = f"method 1: {number(one)} frames/s, method 2: {number(two)}"
    slower = "yes" if two < one * (1 - EQUAL) else "no"
    quick = "yes" if min(one, two) > FRAMES_PER_SECOND else "no"
    steps = f"of {entry['frame_steps']} steps each; of one step, as Table 2 has them: {number(two * entry['frame_steps'])}"
    return [
        Finding("3", "method 2 is somewhat slower than method 1", slower, "not timed", ours),
        Finding("3", f"both show more than {FRAMES_PER_SECOND} frames/s", quick, "not timed", f"{ours}, {steps}"),
    ]


def _gpu(entry: dict[str, Any]) -> list[Finding]:
    claim = "method 2 on the GPU is 60 % faster than on the CPU"
    best = dict.fromkeys(("SIMD core", "shader"), 0.0)
    for row in entry["rows"]:
        kind = row["kind"].partition(",")[0]
        if kind in best and "[a CPU]" not in row["kind"]:
            best[kind] = max(best[kind], row["steps_per_second"])
    if not best["shader"]:
        return [Finding("4", claim, "not measured", "not timed", f"no graphics card here ({entry['gpu_missing']})")]
    ratio = best["shader"] / best["SIMD core"]
    held = "yes" if ratio >= GPU_OVER_CPU else "no"
    return [
        Finding("4", claim, held, "not timed", f"{number(ratio)} times the steps/s of the core ({', '.join(entry['gpu'])})")
    ]


def here(key: str, entry: dict[str, Any]) -> str:
    """One sentence on what the experiment gave here."""
    if key == "1":
        one, two = (max(_depths(entry, k, "as printed"), default=0.0) for k in (1, 2))
        coarse = [r for r in entry["study"] if r["dt"] == max((s["dt"] for s in entry["study"]), default=0.0)]
        depths = {r["method"]: max(p["points"] for p in r["penetration"]) for r in coarse}
        more = (
            f" With one step a frame the difference of the paper appears: points {number(1e3 * depths[1], 2)} mm deep with "
            f"method 1, {number(1e3 * depths[2], 2)} mm with method 2."
            if len(depths) == 2
            else ""
        )
        return (
            f"As printed, the deepest triangle is {number(1e3 * one, 2)} mm deep with method 1 and "
            f"{number(1e3 * two, 2)} mm with method 2, in cells whose corners lie on the sphere.{more}"
        )
    if key == "2":
        (row,) = _moving(entry)
        return f"As printed, {row.printed}; corrected, {row.corrected}."
    if key == "3":
        slower, rate = _rates(entry)
        return f"{slower.corrected}: {'as the paper says' if slower.held == 'yes' else 'the difference is not reproduced'}."
    if key == "4":
        core = max((r for r in entry["rows"] if r["kind"] == "SIMD core"), key=lambda r: r["speedup"])
        return (
            f"The core takes up to {number(core['speedup'])} times the steps of the scalar reference in {core['precision']} "
            f"on {core['threads']} thread{'s' * (core['threads'] > 1)}; {_gpu(entry)[0].corrected}."
        )
    passed = {r["response"] for r in entry["rows"] if r["crossings"] or r["failure"]}
    held = dict.fromkeys(r["response"] for r in entry["rows"] if r["response"] not in passed)
    return f"No mass point passes with {', '.join(held)}."
