"""Sentences about what was measured, each worked out from the numbers of the report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .paper_settings import PAPER_DT
from .paper_tables import number, per_frame
from .performance import CORE, SHADER
from .published import FRAMES_PER_SECOND, VARIANTS

SAME = 0.25  # depths that differ by less than this fraction are called alike
DEEP = 2.0  # mm; more is deeper than the cloth's triangles cut into the sphere between points
MILLIMETRE = 1e3


def of(experiment: str, entry: dict[str, Any]) -> list[str]:
    """The findings of experiment "1" to "5"."""
    made = {"1": _static, "2": _moving, "3": _methods, "4": _speedup, "5": _comparison}
    return made[experiment](entry)


def _cells(entry: dict[str, Any], method: int, variant: str) -> list[dict[str, Any]]:
    return [c for c in entry["cells"] if (c["method"], c["variant"]) == (method, variant)]


def _depths(cells: list[dict[str, Any]], part: str = "triangles") -> list[float]:
    return [MILLIMETRE * cell["penetration"][part] for cell in cells]


def _listed(values: Iterable[float]) -> str:
    return " / ".join(number(value) for value in values)


def _alike(a: float, b: float) -> bool:
    return abs(a - b) <= SAME * max(abs(a), abs(b))


def _depth_lines(entry: dict[str, Any]) -> list[str]:
    frames = " / ".join(map(str, entry["frames"]))
    lines = []
    for variant in VARIANTS:
        first, second = (_listed(_depths(_cells(entry, m, variant))) for m in (1, 2))
        lines.append(f"Deepest triangle at frames {frames}, {variant}: method 1 {first} mm, method 2 {second} mm.")
    return lines


def _failures(entry: dict[str, Any]) -> list[str]:
    return [
        f"Method {h['method']}, {h['variant']}, ended early: {h['failure']}." for h in entry["histories"] if h["failure"]
    ]


def _static(entry: dict[str, Any]) -> list[str]:
    if failures := _failures(entry):
        return failures
    lines = _depth_lines(entry)
    first, second = (_cells(entry, method, "as printed") for method in (1, 2))
    corrected = _cells(entry, 1, "corrected")
    worst1, worst2 = (max(_depths(cells)) for cells in (first, second))
    if _alike(worst1, worst2):
        sink = 1e6 * entry["impact_speed"] * entry["dt"]
        lines.append(
            "Differs from the paper: both methods lie about equally deep. At "
            f"dt = {entry['dt']:g} s a point that meets the sphere at "
            f"{number(entry['impact_speed'])} m/s sinks no more than {number(sink)} um before it "
            "is turned back, so leaving its position alone, as method 1 does, costs next to "
            "nothing."
        )
    else:
        order = "deeper" if worst1 > worst2 else "less deep"
        agrees = "Agrees with" if worst1 > worst2 else "Differs from"
        lines.append(
            f"{agrees} the paper in order: method 1 lies {order} than method 2, "
            f"{number(worst1)} against {number(worst2)} mm."
        )
    if worst2 > 0:
        lines.append(
            f"Method 2 is not free of penetration: its points stay outside, its triangles dip "
            f"{number(worst2)} mm in. The offset of eq 13 covers the middle of an unstretched "
            "structural spring; the middle of a cell's diagonal would need "
            f"{number(MILLIMETRE * entry['diagonal_shortfall'])} mm more, a stretched cell more "
            "still. In a picture that is less than a pixel."
        )
    stuck, free = (cells[-1]["points_touching"] for cells in (first, corrected))
    if stuck > 1.5 * free:
        lines.append(
            f"Method 1 as printed makes points stick: {stuck} touch the sphere at frame "
            f"{first[-1]['frame']}, {free} when corrected. It also turns back a point that is already "
            "leaving."
        )
    return [*lines, *_study(entry), *_static_energy(entry)]


def _study(entry: dict[str, Any]) -> list[str]:
    """Findings at the coarsest step that both methods survive."""
    by_dt: dict[float, dict[int, list[dict[str, Any]]]] = {}
    for row in entry["step_study"]:
        by_dt.setdefault(row["dt"], {})[row["method"]] = row["penetration"]
    shared = [dt for dt, rows in by_dt.items() if len(rows) == 2]
    if not shared:
        return []
    first, second = (by_dt[max(shared)][method] for method in (1, 2))
    appears = all(a["points"] > 0 == b["points"] for a, b in zip(first, second, strict=True))
    numbers = (
        f"method 1 leaves points {per_frame(first, 'points')} mm and triangles "
        f"{per_frame(first, 'triangles')} mm inside, method 2 {per_frame(second, 'points')} and "
        f"{per_frame(second, 'triangles')} mm"
    )
    if appears:
        return [
            f"With a step of {max(shared):g} s the paper's difference appears, at every frame: "
            f"{numbers}. Its pictures fit a coarser step than its Table 2 prints."
        ]
    return [f"A step of {max(shared):g} s does not bring the paper's difference out: {numbers}."]


def _static_energy(entry: dict[str, Any]) -> list[str]:
    last = {m: _cells(entry, m, "corrected")[-1] for m in (1, 2)}
    made = {m: cell["contact_energy"] for m, cell in last.items()}
    return [
        f"Energy made by the collision passes up to frame {last[2]['frame']} (corrected): method 1 "
        f"{number(made[1])} J, method 2 {number(made[2])} J. Turning a velocity keeps its energy; "
        "moving a point, as method 2 does, also changes springs and height."
    ]


def _moving(entry: dict[str, Any]) -> list[str]:
    if failures := _failures(entry):
        return failures
    lines = _depth_lines(entry)
    touching = " / ".join(str(c["points_touching"]) for c in _cells(entry, 2, "corrected"))
    lines.append(
        f"Points that touch the sphere at these frames (method 2, corrected): {touching}. The "
        "sphere's period is chosen so that they fall into the first, second and third contact."
    )
    lines += _moving_first(entry) + _moving_second(entry)
    last = {m: _cells(entry, m, "corrected")[-1] for m in (1, 2)}
    depth = {m: MILLIMETRE * cell["deepest_so_far"]["triangles"] for m, cell in last.items()}
    alike = _alike(depth[1], depth[2])
    lines.append(
        f"Mended, the methods are {'alike' if alike else 'apart'}: over the whole run triangles "
        f"dip {number(depth[1])} mm with method 1 and {number(depth[2])} mm with method 2."
        + (" What the printed form lacks is the sphere's own velocity." if alike else "")
    )
    return lines


def _moving_first(entry: dict[str, Any]) -> list[str]:
    cells = _cells(entry, 1, "as printed")
    inside = [c["frame"] for c in cells if MILLIMETRE * c["penetration"]["points"] > DEEP]
    outside = [c for c in cells if c["frame"] not in inside]
    lines = []
    if inside:
        lines.append(
            f"Agrees with the paper at frame{'s' if inside[1:] else ''} {_and(inside)}: with "
            "method 1 as printed the sphere moves into the cloth, because a point that is "
            "overtaken is slow and only turned, never moved."
        )
    for cell in outside:
        crossed = cell["deepest_so_far"]["points"] > 0.5 * entry["radius"]
        why = (
            " By then the sphere has gone right through the cloth: points have been "
            f"{number(MILLIMETRE * cell['deepest_so_far']['points'])} mm deep."
            if crossed
            else ""
        )
        lines.append(
            f"Differs from the paper at frame {cell['frame']}: no point is deeper than "
            f"{number(DEEP)} mm with method 1 as printed.{why}"
        )
    return lines


def _moving_second(entry: dict[str, Any]) -> list[str]:
    printed, corrected = (_cells(entry, 2, variant)[-1] for variant in VARIANTS)
    made, usual = printed["contact_energy"], corrected["contact_energy"]
    depth = MILLIMETRE * printed["deepest_so_far"]["triangles"]
    numbers = (
        f"its collision passes add {number(made)} J (corrected: {number(usual)} J, the work of the "
        f"moving sphere included) and triangles are up to {number(depth)} mm deep"
    )
    if made > 10 * abs(usual):
        return [
            f"Differs from the paper: method 2 as printed does not stay quiet, {numbers}. The ray "
            "runs back along the point's own velocity; for a point that the sphere has caught up "
            "with that is not where the sphere came from, and the point is thrown far across."
        ]
    return [f"Agrees with the paper: method 2 as printed stays quiet, {numbers}."]


def _methods(entry: dict[str, Any]) -> list[str]:
    first, second = entry["rows"]
    change = second["microseconds_per_step"] / first["microseconds_per_step"] - 1
    spread = max(row["upper_quartile"] / row["lower_quartile"] - 1 for row in entry["rows"])
    slower = "slower" if change > 0 else "faster"
    beyond = abs(change) > spread
    agrees = "as in the paper" if beyond and change > 0 else "not what the paper shows"
    lines = [
        f"Method 1 {number(first['microseconds_per_step'])} us a step, method 2 "
        f"{number(second['microseconds_per_step'])} us: method 2 is {number(100 * abs(change), 2)} "
        f"% {slower}, "
        + (
            f"{agrees}; the quartiles of the runs lie {number(100 * spread, 2)} % apart."
            if beyond
            else "which is less than the quartiles of the runs lie apart, "
            f"{number(100 * spread, 2)} %. Few points touch the sphere, and each step evaluates "
            "every spring four times."
        )
    ]
    rate, frame = second["steps_per_second"], entry["frame_steps"]
    lines.append(
        f"Read as Table 2 puts it, one step a frame, method 2 runs at {number(rate)} frames/s, "
        f"{number(rate / FRAMES_PER_SECOND)} times the paper's {FRAMES_PER_SECOND}. With frames of "
        f"{number(MILLIMETRE * frame * PAPER_DT)} ms, {frame} steps, it is "
        f"{number(rate / frame)} frames/s, {number(rate * PAPER_DT)} times real time."
    )
    seconds = FRAMES_PER_SECOND * PAPER_DT
    lines.append(
        f"At {FRAMES_PER_SECOND} frames/s of one step each the paper's cloth would cover "
        f"{number(MILLIMETRE * seconds)} ms in a second of waiting, and its 800 frames "
        f"{number(MILLIMETRE * 800 * PAPER_DT)} ms, in which it falls less than 0.1 mm: its frames "
        "must be longer than one printed step."
    )
    return lines


def _speedup(entry: dict[str, Any]) -> list[str]:
    reference, *others = entry["rows"]
    core = [row for row in others if row["kind"] == CORE]
    lines = [
        f"The {row['kind']} in {row['precision']} precision on {row['threads']} "
        f"thread{'s' if row['threads'] > 1 else ''} takes "
        f"{number(row['microseconds_per_step'])} us a step, {number(row['speedup'])} times as fast "
        f"as the scalar reference ({number(reference['microseconds_per_step'])} us)."
        for row in core
    ]
    by_key = {(row["precision"], row["threads"]): row for row in core}
    most = max(row["threads"] for row in core)
    if most > 1:
        gain = by_key["double", most]["steps_per_second"] / by_key["double", 1]["steps_per_second"]
        why = (
            "1,024 mass points are little work to share"
            if gain > 1
            else "what a busy processor does, as each step waits for the last thread"
        )
        lines.append(f"{most} threads are {number(gain)} times as fast as one: {why}.")
    best = max(row["speedup"] for row in core if row["precision"] == "double")
    lines.append(
        f"The paper's gain of 60 % is a GPU over its own CPU code; the {number(best)} times here, "
        "in the same precision, are one CPU over a scalar code compiled with the same "
        "optimisation. The two ratios have different denominators and are not to be compared."
    )
    first = by_key["double", most]
    lines.append(
        f"Set-up, which slows the paper's first measurement, takes "
        f"{number(MILLIMETRE * first['setup_seconds'])} ms here and is not part of the rates."
    )
    lines.append(
        f"Both compute the same: after {entry['agreement_steps']} steps positions differ by no "
        f"more than {number(entry['agreement'])} m."
    )
    return [*lines, *_shader(others), *_over_sizes(entry)]


def _shader(rows: list[dict[str, Any]]) -> list[str]:
    lines = []
    for row in rows:
        if not row["kind"].startswith(SHADER):
            continue
        same = [r for r in rows if r["kind"] == CORE and r["precision"] == row["precision"]]
        best = max(r["steps_per_second"] for r in same)
        lines.append(
            f"The {row['kind']}, in {row['precision']} precision takes "
            f"{number(row['microseconds_per_step'])} us a step, "
            f"{number(row['steps_per_second'] / best)} times the speed of the fastest CPU row of that "
            "precision (the paper: 1.6). Making its buffers and pipelines takes "
            f"{number(MILLIMETRE * row['first_setup_seconds'])} ms the first time; that slows the "
            "paper's first measurement and is not part of the rates."
        )
    return lines


def _over_sizes(entry: dict[str, Any]) -> list[str]:
    if "gpu" not in entry:
        return []
    return [*entry["gpu"]["warnings"], *entry["gpu"]["crossovers"]]


def _comparison(entry: dict[str, Any]) -> list[str]:
    lines = []
    for scene in dict.fromkeys(row["scene"] for row in entry["rows"]):
        rows = {row["response"]: row for row in entry["rows"] if row["scene"] == scene}
        worst = max(rows.values(), key=lambda row: row["triangles"])
        face = rows["continuous, face"]
        safe = not (face["points"] or face["triangles"] or face["crossings"] or face["failure"])
        through = {name: row["crossings"] for name, row in rows.items() if row["crossings"]}
        told = ", ".join(f"{count} with {name}" for name, count in through.items()) or "none"
        lines.append(
            f"{scene.capitalize()} sphere: deepest triangle "
            f"{number(MILLIMETRE * worst['triangles'])} mm ({worst['response']}), "
            f"{number(MILLIMETRE * rows['continuous']['triangles'])} mm continuous. Points that "
            f"passed between two steps: {told}. Continuous with face offset: "
            + ("no point, no triangle inside, none passed." if safe else "NOT free of penetration.")
        )
    made = {row["response"]: row["contact_energy"] for row in entry["rows"] if row["scene"] == "static"}
    lines.append(
        "Energy added by contact with the static sphere, which should be 0 at restitution 1: "
        + ", ".join(f"{name} {number(value)} J" for name, value in made.items())
        + "."
    )
    return lines


def _and(values: Iterable[Any]) -> str:
    return " and ".join(map(str, values))
