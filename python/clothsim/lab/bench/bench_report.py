"""The bench as text."""

from __future__ import annotations

from typing import Any

from . import bench_tables as tables
from .bench_settings import BATCH_LONGER, IN_TURN
from .figures import A_STEP_A_CALL, CS_STEP, FEATURE, PAPER_WORKS
from .measured_run import ALL_SPRINGS


def text(report: dict[str, Any]) -> str:
    """The whole report as plain text."""
    figures = report["figures"]
    parts = [_machine(report)]
    if report["limits"]:
        parts.append(_limits(report["limits"]))
    steps = [f for f in figures if f["work"].startswith(PAPER_WORKS)]
    if steps:
        parts.append(tables.steps(steps))
    if any(f["work"] == ALL_SPRINGS for f in figures):
        parts.append(tables.features([f for f in figures if f["work"].startswith(FEATURE)]))
    others = [f for f in figures if not f["work"].startswith((*PAPER_WORKS, FEATURE))]
    if others:
        parts.append(tables.others(others))
    if any(f["work"].endswith((A_STEP_A_CALL, CS_STEP)) for f in others):
        parts.append(tables.calls(others))
    if report["efficiency"]:
        parts.append(tables.efficiency(report["efficiency"]))
    if report["accuracy"]:
        parts.append(tables.accuracy(report["accuracy"]))
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
    lines = ["Limits of this machine", *tables.table(("multiply-adds", "threads", "Gflop/s"), rows)]
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
