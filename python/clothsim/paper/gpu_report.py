"""Experiment 4 over sizes, reported: the faster target, the size from which it is faster, tables, files and the plot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.gpu import Adapter
from clothsim.machine import processor

from ..base.plots import BLUE, GREY, RED, figure, name_lines, save
from ..base.table import write_csv
from . import paper_settings
from .gpu_runs import GPU, Measurement, run, settings_of

WARNING = (
    "{name} is a CPU that runs shaders, no GPU: its figures say nothing about a graphics card, only that the shader runs."
)


def warnings(measurements: Iterable[Measurement]) -> list[str]:
    """One sentence for every adapter that is no GPU."""
    names = {m.target.name.replace(" [a CPU]", "") for m in measurements if m.target.software}
    return [WARNING.format(name=name) for name in sorted(names)]


def _groups(measurements: Sequence[Measurement]) -> dict[tuple[Any, ...], list[Measurement]]:
    groups: dict[tuple[Any, ...], list[Measurement]] = {}
    for m in measurements:
        groups.setdefault((m.precision, m.method, m.size, m.members), []).append(m)
    return groups


def against_cpu(m: Measurement, measurements: Sequence[Measurement]) -> float | None:
    """Steps/s of `m` over the steps/s of the fastest CPU target with this scene."""
    same = _groups(measurements)[m.precision, m.method, m.size, m.members]
    rates = [one.rate for one in same if one.target.kind != GPU]
    return m.rate / max(rates) if rates else None


def crossover(
    measurements: Sequence[Measurement], target: str, precision: str, method: int, batch: bool
) -> Measurement | None:
    """The smallest scene from which on `target` is faster than every CPU target.

    `batch` selects batches; otherwise single cloths are compared. None if the target is not faster at the largest size.
    """
    mine = [
        m
        for m in measurements
        if (m.target.name, m.precision, m.method) == (target, precision, method) and (m.members > 1) == batch
    ]
    first = None
    for m in sorted(mine, key=lambda m: m.points, reverse=True):
        gain = against_cpu(m, measurements)
        if gain is None or gain <= 1:
            break
        first = m
    return first


def crossovers(measurements: Sequence[Measurement]) -> list[str]:
    """A sentence for every adapter, precision, method and kind of scene."""
    lines = []
    keys = dict.fromkeys((m.target.name, m.precision, m.method, m.members > 1) for m in measurements if m.target.kind == GPU)
    for name, precision, method, batch in keys:
        first = crossover(measurements, name, precision, method, batch)
        what = "batches" if batch else "single cloths"
        start = f"{name}, {precision}, method {method}, {what}: "
        if first is None:
            lines.append(start + "no crossover, the CPU is faster up to the largest measured.")
            continue
        gain = against_cpu(first, measurements)
        where = f"faster than the CPU from {scene_name(first)} on ({gain:.2g} times there)."
        lines.append(start + where)
    return lines


def frames_per_run(m: Measurement) -> float:
    """Frames that a run's window holds, in the mean over the runs."""
    return sum(m.steps) / (m.frame_steps * len(m.steps))


def scene_name(m: Measurement) -> str:
    """The size of a scene, and how many cloths it has."""
    return f"{m.size} x {m.size}" + (f", {m.members} cloths" if m.members > 1 else "")


def by_table(measurements: Sequence[Measurement]) -> dict[tuple[str, int], list[Measurement]]:
    """By precision and method."""
    tables: dict[tuple[str, int], list[Measurement]] = {}
    for m in measurements:
        tables.setdefault((m.precision, m.method), []).append(m)
    return tables


def rows(measurements: Sequence[Measurement]) -> list[dict[str, Any]]:
    """One mapping per measurement, a row of the CSV file."""
    cpu = processor()["cpu"]
    result = []
    for m in measurements:
        low, high = m.quartiles()
        gain = against_cpu(m, measurements)
        result.append(
            {
                "version": cs.__version__,
                "cpu": cpu,
                "instruction_set": cs.build_config()["instruction_set"],
                "target": m.target.kind,
                "name": m.target.name,
                "software_adapter": m.target.software,
                "threads": m.target.threads,
                "precision": m.precision,
                "method": m.method,
                "rows": m.size,
                "columns": m.size,
                "members": m.members,
                "mass_points": m.points,
                "runs": len(m.rates),
                "steps_asked": m.asked * len(m.rates),
                "steps_timed": sum(m.steps),
                "frames_per_run": frames_per_run(m),
                "shortened": m.shortened,
                "steps_per_second": m.rate,
                "lower_quartile": low,
                "upper_quartile": high,
                "us_per_step": 1e6 / m.rate,
                "cloth_steps_per_second": m.rate * m.members,
                "ns_per_point_step": 1e9 / (m.rate * m.points),
                "memory_bytes_per_second": m.bandwidth,
                "memory_bytes_per_point_step": m.bandwidth / (m.rate * m.points),
                "times_fastest_cpu": "" if gain is None else gain,
                "first_run_setup_seconds": m.setup[0],
                "first_frame_seconds_per_step": m.first_frames[0][0],
                "last_frame_seconds_per_step": m.first_frames[0][-1],
            }
        )
    return result


def write(measurements: Sequence[Measurement], folder: Path, name: str) -> list[Path]:
    """The table `name`.csv and, with matplotlib, `name`.png in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [write_csv(folder / f"{name}.csv", rows(measurements))]
    try:
        files.append(draw(measurements, folder / f"{name}.png"))
    except ImportError:
        pass  # the figures are in the CSV file
    return files


_COLORS = {"scalar": GREY, "SIMD": BLUE, "GPU": RED}


def draw(measurements: Sequence[Measurement], path: Path) -> Path:
    """The plot: speed over size with the crossover, and the first frames apart."""
    tables = by_table(measurements)
    drawn, panels = figure(11.5, 3.9 * len(tables) + 0.6, len(tables), 2, width_ratios=(2, 1))
    for (title, group), (speed, start) in zip(tables.items(), panels, strict=True):
        _draw_speed(speed, group, measurements)
        speed.set_title(f"{title[0]}, method {title[1]}", loc="left", fontsize="medium")
        _draw_first_frames(start, group)
    if warned := warnings(measurements):
        drawn.suptitle("\n".join(warned), fontsize="small", color=_COLORS["GPU"])
    save(drawn, path)
    return path


_STYLES = ("-", "--", ":", "-.")


def _draw_speed(panel: Any, group: list[Measurement], everything: Sequence[Measurement]) -> None:
    styles: dict[str, int] = {}
    for name in dict.fromkeys(m.target.name for m in group):
        mine = [m for m in group if m.target.name == name]
        kind = mine[0].target.kind
        place = styles[kind] = styles.get(kind, -1) + 1
        style = {"color": _COLORS[kind], "ls": _STYLES[place % len(_STYLES)], "ms": 4}
        for batch, marker in ((False, "o"), (True, "s")):
            part = sorted((m for m in mine if (m.members > 1) == batch), key=lambda m: m.points)
            panel.plot(
                [m.points for m in part],
                [m.rate * m.points for m in part],
                marker=marker,
                mfc="white" if batch else _COLORS[kind],
                **style,
                label=None if batch else name,
            )
        if kind == GPU:
            for batch in (False, True):
                first = crossover(everything, name, group[0].precision, group[0].method, batch)
                if first:
                    _mark(panel, first)
    panel.set(
        xscale="log", yscale="log", xlabel="mass points (filled: one cloth, open: batch)", ylabel="mass points x steps / s"
    )
    name_lines(panel)


def _mark(panel: Any, first: Measurement) -> None:
    """Where the shader becomes faster."""
    where = f"{first.members} cloths" if first.members > 1 else f"{first.size} x {first.size}"
    panel.axvline(first.points, color=_COLORS[GPU], lw=0.8, ls="--" if first.members > 1 else "-")
    panel.annotate(
        f"faster from {where} on",
        (first.points, 0.03),
        rotation=90,
        xycoords=("data", "axes fraction"),
        fontsize="x-small",
        ha="right",
    )


def _draw_first_frames(panel: Any, group: list[Measurement]) -> None:
    least = min(m.points for m in group)
    for m in group:
        if m.points != least:
            continue
        frames = m.first_frames[0]
        settled = 1 / m.rate
        panel.plot(
            range(1, len(frames) + 1),
            [seconds / settled for seconds in frames],
            marker="o",
            ms=3,
            color=_COLORS[m.target.kind],
            label=m.target.name,
        )
    panel.axhline(1, color=GREY, lw=0.8)
    panel.xaxis.get_major_locator().set_params(integer=True)
    panel.set(yscale="log", xlabel="frame of the first run (smallest scene)", ylabel="time of a step / its median later")


def over_sizes(
    settings: paper_settings.Settings, found: list[Adapter], folder: Path, *, advance: Callable[..., Any] = lambda runs: None
) -> dict[str, Any]:
    """CPU against GPU over cloth sizes and batches, in compensated single precision.

    "rows" has one entry per scene, method and target, "crossovers" and "warnings" sentences, "csv" and "plot" file names.
    """
    measurements = run(settings_of(settings), found, advance=advance)
    files = write(measurements, folder, "figure10_sizes")
    return {
        "rows": rows(measurements),
        "crossovers": crossovers(measurements),
        "warnings": warnings(measurements),
        "csv": [file.name for file in files if file.suffix == ".csv"],
        "plot": "figure10_sizes.png",
    }
