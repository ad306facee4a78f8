"""The bench as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from common import aligned

from .figures import A_STEP_A_CALL, ALL_SPRINGS, CS_STEP, FEATURE, PAPER_WORKS, RATIOS
from .settings import BATCH_LONGER, IN_TURN


def text(report: dict[str, Any]) -> str:
    """The whole report as plain text."""
    figures = report["figures"]
    parts = [_machine(report)]
    if report["limits"]:
        parts.append(_limits(report["limits"]))
    steps = [f for f in figures if f["work"].startswith(PAPER_WORKS)]
    if steps:
        parts.append(_steps(steps))
    if any(f["work"] == ALL_SPRINGS for f in figures):
        parts.append(_features([f for f in figures if f["work"].startswith(FEATURE)]))
    others = [f for f in figures if not f["work"].startswith((*PAPER_WORKS, FEATURE))]
    if others:
        parts.append(_others(others))
    if any(f["work"].endswith((A_STEP_A_CALL, CS_STEP)) for f in others):
        parts.append(_calls(others))
    if report["efficiency"]:
        parts.append(_efficiency(report["efficiency"]))
    if report["accuracy"]:
        parts.append(_accuracy(report["accuracy"]))
    if report["before"]:
        parts.append([report["before"]])
    for one in report["skipped"]:
        labels = ", ".join(f"{key} {value}" for key, value in one.items() if key != "reason")
        parts.append([f"Left out ({labels}): {one['reason']}"])
    return "\n\n".join("\n".join(lines) for lines in parts)


def _machine(report: dict[str, Any]) -> list[str]:
    about, build = report["machine"], report["machine"]["build"]
    load = about["load_average"]
    lines = [
        f"clothsim {build['version']}, {build['instruction_set']}, {build['compiler']}",
        f"{_processor(about)}, {about['cores']} cores, {about['system']}, {about['created']}",
    ]
    if load:
        shown = ", ".join(f"{one:.2f}" for one in load)
        lines.append(f"load average over 1, 5 and 15 minutes before the run {shown}")
        if load[0] > 0.5:
            lines.append(
                "Something ran in the minute before, a build perhaps. If it still did later, the "
                "figures below are too high: medians far above the least times tell."
            )
    return lines + (_windows(report["settings"]) if report["figures"] else [])


def _windows(settings: dict[str, Any]) -> list[str]:
    windows, length = settings["windows"], 1e3 * settings["seconds"]
    return [
        f"Each time is the least of {windows} windows of {length:g} ms (a step, where that is "
        "longer), taken in turn with the others of its group. Other windows:",
        f"batch, {max(1, windows // BATCH_LONGER)} of {BATCH_LONGER * length:g} ms; grids above "
        f"{IN_TURN} x {IN_TURN}, {settings['large_windows']} one after the other; after a pause, "
        f"{windows} of exactly the steps named.",
    ]


def _processor(about: dict[str, Any]) -> str:
    keys = (key for key in ("family", "model", "stepping") if about[key] is not None)
    told = [f"{key} {about[key]}" for key in keys]
    return str(about["cpu"]) + (f" ({', '.join(told)})" if told else "")


# Of the peak of as many cores. A virtual machine's processors may be put on one and the same.
_ALMOST_ALL = 0.75


def _limits(limits: dict[str, Any]) -> list[str]:
    rows = [
        (f"{p['instruction_set']}, {p['precision']}", str(p["threads"]), f"{p['flops_per_second'] / 1e9:.1f}")
        for p in limits["peak"]
    ]
    lines = ["Limits of this machine", *_table(("multiply-adds", "threads", "Gflop/s"), rows)]
    peak = {(p["instruction_set"], p["precision"], p["threads"]): p["flops_per_second"] for p in limits["peak"]}
    for name in ("bandwidth", "triad", "cache_bandwidth"):
        rates = ", ".join(f"{rate / 1e9:.1f} on {t}" for t, rate in limits[name].items())
        lines.append(f"{name.replace('_', ' ')} [GB/s]: {rates} threads")
    if limits["round_trip"] is not None:
        lines.append(f"core to core and back: {1e9 * limits['round_trip']:.0f} ns")
    shares = [(p["flops_per_second"] / peak[p["instruction_set"], p["precision"], 1], p["threads"]) for p in limits["peak"]]
    ratio, threads = min(shares, key=lambda share: share[0] / share[1])
    if ratio < _ALMOST_ALL * threads:
        lines.append(
            f"{threads} threads reached {ratio:.2f} times the peak of one: their processors shared "
            "a core, at least at that time. Figures on several threads may be too high."
        )
    return lines


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Columns aligned: the first to the left, the others to the right."""
    return aligned(head, rows, rule=True).split("\n")


def _label(figure: dict[str, Any]) -> str:
    strict = ", strict" if figure["strict"] else ""
    isa = f", {figure['instruction_set']}" if figure["instruction_set"] else ""
    return f"{figure['by']}{strict}{isa}"


def _threads(figure: dict[str, Any]) -> str:
    return "auto" if figure["threads"] is None else str(figure["threads"])


def _error(figure: dict[str, Any]) -> str:
    return "" if figure["error"] is None else f"{figure['error']:.1e}"


def _error_steps(figures: list[dict[str, Any]]) -> str:
    """The number of steps after which deviations are taken; empty if there are none."""
    counts = sorted({f["error_steps"] for f in figures if f["error"] is not None})
    after = " and ".join(f"{count:,}" for count in counts)
    return f"; the error is that of the position after {after} steps of 5 us" if after else ""


def _columns(figures: list[dict[str, Any]]) -> dict[str, str]:
    """Heads of the ratios that some of the figures have, and their names."""
    return {f"x {peer}": c for peer, c in RATIOS.items() if any(f[c] for f in figures)}


def _ratios(figure: dict[str, Any], columns: dict[str, str]) -> list[str]:
    return ["" if figure[c] is None else f"{figure[c]:.1f}" for c in columns.values()]


def _steps(figures: list[dict[str, Any]]) -> list[str]:
    lines = [
        f"32 x 32 mass points{_error_steps(figures)}",
        "x: how many times faster than a peer of the same precision (the reference has double "
        "only), as many springs and no sphere, on the thread count on which that is fastest",
    ]
    for work in dict.fromkeys(f["work"] for f in figures):
        group = [f for f in figures if f["work"] == work]
        columns = _columns(group)
        rows = [
            (
                _label(f),
                f["precision"],
                _threads(f),
                f"{1e6 * f['minimum']:.2f}",
                f"{1e6 * f['median']:.2f}",
                _error(f),
                *_ratios(f, columns),
            )
            for f in sorted(group, key=lambda f: f["minimum"])
        ]
        head = ("by", "precision", "threads", "min us", "median", "error m", *columns)
        lines += ["", f"{work}: {group[0]['springs']:,} springs", *_table(head, rows)]
    return lines


def _features(figures: list[dict[str, Any]]) -> list[str]:
    lines = ["Price of features, 32 x 32, one thread"]
    for by, precision in dict.fromkeys((f["by"], f["precision"]) for f in figures):
        group = [f for f in figures if (f["by"], f["precision"]) == (by, precision)]
        base = next(f for f in group if f["work"] == ALL_SPRINGS)
        columns = _columns(group)
        rows = [
            (
                f["work"].removeprefix(FEATURE),
                f"{1e6 * f['minimum']:.2f}",
                f"{100 * (f['minimum'] / base['minimum'] - 1):+.1f}",
                f"{100 * (f['flops'] / base['flops'] - 1):+.1f}",
                *_ratios(f, columns),
            )
            for f in group
        ]
        head = (f"{by}, {precision}", "min us", "time %", "flops %", *columns)
        lines += ["", *_table(head, rows)]
    return lines


def _others(figures: list[dict[str, Any]]) -> list[str]:
    columns = _columns(figures)
    rows = [
        (
            f["work"],
            _label(f),
            f["precision"],
            _threads(f),
            f"{1e6 * f['minimum']:.2f}",
            f"{1e6 * f['median']:.2f}",
            f"{1e9 * f['minimum'] / f['points']:.2f}",
            f"{1 / f['minimum']:,.0f}",
            _error(f),
            *_ratios(f, columns),
        )
        for f in figures
    ]
    head = ("work", "by", "precision", "threads", "min us", "median", "ns a point", "steps/s", "error m", *columns)
    title = "Batch (a cloth-step), grids, frames, pauses and calls"
    return [title + _error_steps(figures), *_table(head, rows)]


def _calls(figures: list[dict[str, Any]]) -> list[str]:
    """Time of a step within a call of many, and the addition of a call for each."""
    labels = ("by", "precision", "threads")
    times = {(f["work"], *(f[k] for k in labels)): 1e6 * f["minimum"] for f in figures}
    rows = []
    for (work, by, precision, threads), within in times.items():
        alone = [times.get((work + how, by, precision, threads)) for how in (A_STEP_A_CALL, CS_STEP)]
        if any(alone):
            added = ("" if one is None else f"{one - within:.2f}" for one in alone)
            rows.append((work, by, precision, str(threads), f"{within:.2f}", *added))
    head = ("work", "by", "precision", "threads", "a step", "+ Stepper.advance", "+ cs.step")
    return ["Calls [us]: a step of many in a call, and what a call a step adds", *_table(head, rows)]


def _efficiency(rows: list[dict[str, Any]]) -> list[str]:
    cells = [
        (
            r["work"],
            f"{r['kernel']}, {r['precision']}",
            str(r["threads"]),
            f"{r['flops_per_step']:,}",
            f"{r['flops_per_second'] / 1e9:.1f}",
            f"{100 * r['share_of_peak']:.0f}",
            str(r["bytes_per_point_step"]),
            f"{1e9 * r['seconds_per_point']:.2f}",
            f"{1e9 * r['arithmetic_seconds_per_point']:.2f}",
            f"{1e9 * r['memory_seconds_per_point']:.2f}",
            r["bound"],
        )
        for r in rows
    ]
    head = ("work", "kernel", "threads", "flops", "Gflop/s", "% of peak", "bytes", "ns", "flops ns", "memory ns", "bound by")
    return [
        "A point-step beside its limits: ns measured, of its flops at the multiply-add peak, and "
        "of its least bytes through memory",
        "swing+bend, 32 x 32 mass points, stays in cache: its bytes do not go through memory",
        *_table(head, cells),
    ]


def _accuracy(accuracy: dict[str, Any]) -> list[str]:
    said = {"duration", "dt", "reference_dt"}
    errors = ", ".join(f"{k} {v:.1e} m" for k, v in accuracy.items() if k not in said)
    return [
        f"Double at dt = {accuracy['dt']:g} s, error after {accuracy['duration']:g} s: {errors} "
        f"(against dt = {accuracy['reference_dt']:g} s)"
    ]
