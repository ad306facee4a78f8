"""The bench as text, CSV and plots."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from .figures import Missing
from .machine import slug
from .targets import ALL_SPRINGS, Measured, share_of_peak

_BYTES = {"single": 96, "double": 96}
"""Least memory traffic of a point-step: state read and written once. 6 components and, in single,
as many compensations."""


def efficiency(measured: Measured) -> list[dict[str, Any]]:
    """Flops, share of the peak, least traffic and bound of each kernel: 5,826 springs, 1 thread."""
    rows = []
    for by in measured.kernels:
        for precision in ("single", "double"):
            try:
                share = share_of_peak(measured, by, precision)
                seconds = measured.seconds("swing+bend", by, precision)
            except Missing:
                continue
            flops, points = measured.flops("swing+bend", by, precision), 32 * 32
            peak = measured.limits["peak"][measured.instruction_sets[0], precision, 1]
            arithmetic = flops / points / peak
            memory = _BYTES[precision] / measured.limits["bandwidth"][1]
            rows.append(
                {
                    "kernel": by,
                    "precision": precision,
                    "flops_per_step": flops,
                    "flops_per_second": flops / seconds,
                    "share_of_peak": share,
                    "bytes_per_point_step": _BYTES[precision],
                    "arithmetic_seconds_per_point": arithmetic,
                    "memory_seconds_per_point": memory,
                    "bound": "arithmetic" if arithmetic > memory else "memory",
                }
            )
    return rows


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Columns aligned: the first to the left, the others to the right."""
    lines = [tuple(head), *map(tuple, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]

    def line(cells: Sequence[str]) -> str:
        first, *others = (f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))
        return "  ".join([f"{cells[0]:<{widths[0]}}", *others]).rstrip()

    return [line(lines[0]), "  ".join("-" * w for w in widths), *map(line, lines[1:])]


def text(report: dict[str, Any]) -> str:
    """The whole report as plain text."""
    figures = report["figures"]
    parts = [_machine(report)]
    if report["limits"]:
        parts.append(_limits(report["limits"]))
    parts.append(_targets(report["targets"], report["machine"]["build"]["instruction_set"]))
    steps = [f for f in figures if f["work"].startswith(("swing", "static", "contact"))]
    if steps:
        parts.append(_steps(steps))
    if any(f["work"] == ALL_SPRINGS for f in figures):
        parts.append(_features([f for f in figures if f["work"].startswith("feature")]))
    others = [f for f in figures if f["work"].startswith(("batch", "grid", "frame", "2 x 2"))]
    if others:
        parts.append(_others(others))
    if report["efficiency"]:
        parts.append(_efficiency(report["efficiency"]))
    if report["accuracy"]:
        parts.append(_accuracy(report["accuracy"]))
    for one in report["skipped"]:
        parts.append([f"Not measured ({one.get('by', '')}): {one['reason']}"])
    return "\n\n".join("\n".join(lines) for lines in parts)


def _machine(report: dict[str, Any]) -> list[str]:
    about, build = report["machine"], report["machine"]["build"]
    load = about["load_average"]
    lines = [
        f"clothsim {build['version']}, {build['instruction_set']}, {build['compiler']}",
        f"{about['cpu']}, {about['cores']} cores, {about['system']}, {about['created']}",
    ]
    if load:
        lines.append("load average before the run " + ", ".join(f"{one:.2f}" for one in load))
        if load[0] > 0.5:
            lines.append("Other work was running: the figures below are too high.")
    windows = report["settings"]["windows"]
    lines.append(
        f"Each time is the least of {windows} short windows taken in turn with all others."
    )
    return lines


# Of the peak of as many cores. A virtual machine's processors may be put on one and the same.
_ALMOST_ALL = 0.75


def _limits(limits: dict[str, Any]) -> list[str]:
    rows = [
        (
            f"{p['instruction_set']}, {p['precision']}",
            str(p["threads"]),
            f"{p['flops_per_second'] / 1e9:.1f}",
        )
        for p in limits["peak"]
    ]
    lines = ["Limits of this machine", *table(("multiply-adds", "threads", "Gflop/s"), rows)]
    peak = {
        (p["instruction_set"], p["precision"], p["threads"]): p["flops_per_second"]
        for p in limits["peak"]
    }
    for name in ("bandwidth", "triad", "cache_bandwidth"):
        rates = ", ".join(f"{rate / 1e9:.1f} on {t}" for t, rate in limits[name].items())
        lines.append(f"{name.replace('_', ' ')} [GB/s]: {rates} threads")
    if limits["round_trip"] is not None:
        lines.append(f"core to core and back: {1e9 * limits['round_trip']:.0f} ns")
    shares = [
        (p["flops_per_second"] / peak[p["instruction_set"], p["precision"], 1], p["threads"])
        for p in limits["peak"]
    ]
    ratio, threads = min(shares, key=lambda share: share[0] / share[1])
    if ratio < _ALMOST_ALL * threads:
        lines.append(
            f"{threads} threads reached {ratio:.2f} times the peak of one: their processors shared "
            "a core, at least at that time. Figures on several threads may be too high."
        )
    return lines


def _number(value: float) -> str:
    return f"{value:.3g}" if value and (value < 1e-3 or value >= 1e6) else f"{value:.4g}"


def _targets(targets: list[dict[str, Any]], instruction_set: str) -> list[str]:
    rows = []
    for one in targets:
        bound = f"{'<=' if one['at_most'] else '>='} {_number(one['bound'])} {one['unit']}"
        if one["missing"]:
            value, met = one["missing"], ""
        else:
            value, met = _number(one["value"]), "met" if one["met"] else "MISSED"
        rows.append((one["target"], bound, value, met, one["prototype"]))
    head = ("Target", "bound", "measured", "", "prototype")
    lines = [*table(head, rows), "* without compensation"]
    if instruction_set != "avx512":
        lines.append(
            "The targets are those of two cores with AVX-512. Here it is "
            f"{instruction_set}, which has fewer lanes."
        )
    return lines


def _label(figure: dict[str, Any]) -> str:
    strict = ", strict" if figure["strict"] else ""
    isa = f", {figure['instruction_set']}" if figure["instruction_set"] else ""
    return f"{figure['by']}{strict}{isa}"


def _threads(figure: dict[str, Any]) -> str:
    return "auto" if figure["threads"] is None else str(figure["threads"])


def _error(figure: dict[str, Any]) -> str:
    return "" if figure["error"] is None else f"{figure['error']:.1e}"


def _steps(figures: list[dict[str, Any]]) -> list[str]:
    lines = ["32 x 32 mass points; the error is that of the position after some steps of 5 us"]
    for work in dict.fromkeys(f["work"] for f in figures):
        group = [f for f in figures if f["work"] == work]

        def least(by: str, group: list[dict[str, Any]] = group) -> float | None:
            return min((f["minimum"] for f in group if f["by"] == by), default=None)

        scales = {
            name: least(name) for name in ("reference", "numpy", "numba gather", "numba strided")
        }
        scales = {name: one for name, one in scales.items() if one}
        rows = [
            (
                _label(f), f["precision"], _threads(f), f"{1e6 * f['minimum']:.2f}",
                f"{1e6 * f['median']:.2f}", _error(f),
                *(f"{one / f['minimum']:.1f}" for one in scales.values()),
            )
            for f in sorted(group, key=lambda f: f["minimum"])
        ]  # fmt: skip
        head = (
            "by",
            "precision",
            "threads",
            "min us",
            "median",
            "error m",
            *(f"x {n}" for n in scales),
        )
        lines += ["", f"{work}: {group[0]['springs']:,} springs", *table(head, rows)]
    return lines


def _features(figures: list[dict[str, Any]]) -> list[str]:
    lines = ["Price of features, 32 x 32, one thread"]
    for by, precision in dict.fromkeys((f["by"], f["precision"]) for f in figures):
        group = [f for f in figures if (f["by"], f["precision"]) == (by, precision)]
        base = next(f for f in group if f["work"] == ALL_SPRINGS)
        rows = [
            (
                f["work"].removeprefix("feature: "),
                f"{1e6 * f['minimum']:.2f}",
                f"{100 * (f['minimum'] / base['minimum'] - 1):+.1f}",
                f"{100 * (f['flops'] / base['flops'] - 1):+.1f}",
            )
            for f in group
        ]
        lines += ["", *table((f"{by}, {precision}", "min us", "time %", "flops %"), rows)]
    return lines


def _others(figures: list[dict[str, Any]]) -> list[str]:
    rows = [
        (
            f["work"], _label(f), f["precision"], _threads(f), f"{1e6 * f['minimum']:.2f}",
            f"{1e9 * f['minimum'] / f['points']:.2f}", f"{1 / f['minimum']:,.0f}", _error(f),
        )
        for f in figures
    ]  # fmt: skip
    head = ("work", "by", "precision", "threads", "min us", "ns a point", "steps/s", "error m")
    return ["Batch (a cloth-step), grids, frames and calls", *table(head, rows)]


def _efficiency(rows: list[dict[str, Any]]) -> list[str]:
    cells = [
        (
            f"{r['kernel']}, {r['precision']}",
            f"{r['flops_per_step']:,}",
            f"{r['flops_per_second'] / 1e9:.1f}",
            f"{100 * r['share_of_peak']:.0f}",
            str(r["bytes_per_point_step"]),
            f"{1e9 * r['arithmetic_seconds_per_point']:.2f}",
            f"{1e9 * r['memory_seconds_per_point']:.2f}",
            r["bound"],
        )
        for r in rows
    ]
    head = ("kernel", "flops", "Gflop/s", "% of peak", "bytes", "flops ns", "memory ns", "bound by")
    return ["5,826 springs, one thread; least bytes and times per point-step", *table(head, cells)]


def _accuracy(accuracy: dict[str, Any]) -> list[str]:
    said = {"duration", "dt", "reference_dt"}
    errors = ", ".join(f"{k} {v:.1e} m" for k, v in accuracy.items() if k not in said)
    return [
        f"Double at dt = {accuracy['dt']:g} s, error after {accuracy['duration']:g} s: {errors} "
        f"(against dt = {accuracy['reference_dt']:g} s)"
    ]


def write(report: dict[str, Any], folder: Path) -> list[str]:
    """Write the figures as CSV and, where matplotlib is there, the plots; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    name = slug(report["machine"])
    path = folder / f"{name}.csv"
    about = {
        "cpu": report["machine"]["cpu"],
        "load": (report["machine"]["load_average"] or [None])[0],
        "created": report["machine"]["created"],
        "version": report["machine"]["build"]["version"],
    }
    with path.open("w", newline="") as file:
        rows = [{**figure, **about} for figure in report["figures"]]
        writer = csv.DictWriter(file, rows[0] if rows else about)
        writer.writeheader()
        writer.writerows(rows)
    targets = folder / f"{name}-targets.csv"
    with targets.open("w", newline="") as file:
        writer = csv.DictWriter(file, report["targets"][0])
        writer.writeheader()
        writer.writerows(report["targets"])
    files = [str(path), str(targets)]
    try:
        from . import plots

        files += plots.draw(report, folder, name)
    except ImportError:
        report["skipped"].append(
            {"by": "plots", "reason": "matplotlib is not installed: pip install 'clothsim[bench]'"}
        )
    return files
