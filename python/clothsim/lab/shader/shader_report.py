"""Experiment 4's measurements as tables and files."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.base.table import aligned
from clothsim.machine import processor

from . import shader_plot as figure
from .comparison import against_cpu, by_table, crossovers, frames_per_run, scene_name, shortened, warnings
from .measurement import GPU, Measurement


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
                "point_steps_per_second": m.rate * m.points,
                "times_fastest_cpu": "" if gain is None else gain,
                "first_run_setup_seconds": m.setup[0],
                "first_frame_seconds_per_step": m.first_frames[0][0],
                "last_frame_seconds_per_step": m.first_frames[0][-1],
            }
        )
    return result


def write_csv(path: Path, entries: Sequence[dict[str, Any]]) -> Path:
    """Write mappings of equal keys as lines of a CSV file."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(entries[0]))
        writer.writeheader()
        writer.writerows(entries)
    return path


def first_frames(measurements: Sequence[Measurement]) -> list[dict[str, Any]]:
    """Every first frame of every run; frame 0 of a run is the making of the stepper."""
    entries = []
    for m in measurements:
        key = {"name": m.target.name, "precision": m.precision, "method": m.method, "rows": m.size, "members": m.members}
        for run, (setup, frames) in enumerate(zip(m.setup, m.first_frames, strict=True), start=1):
            entries.append({**key, "run": run, "frame": 0, "seconds": setup})
            for k, seconds in enumerate(frames, start=1):
                entries.append({**key, "run": run, "frame": k, "seconds": seconds})
    return entries


def text(measurements: Sequence[Measurement]) -> str:
    """The table, the crossovers and the first frames, to read."""
    lines = [f"WARNING: {line}" for line in warnings(measurements)]
    head = ("scene", "us/step", "steps/s", "Mpoints/s", "times CPU", "frames", "by")
    for (precision, method), group in by_table(measurements).items():
        cells = []
        for m in group:
            gain = against_cpu(m, measurements)
            numbers = [f"{value:.4g}" for value in (1e6 / m.rate, m.rate, m.rate * m.points / 1e6)]
            frames = f"{frames_per_run(m):.3g}" + "*" * m.shortened
            cells.append((scene_name(m), *numbers, "" if gain is None else f"{gain:.3g}", frames, m.target.name))
        lines += ["", f"{precision}, method {method}", aligned(head, cells, left=(6,))]
    lines += ["", *shortened(measurements)]
    lines += ["", "Where the shader becomes faster:", *crossovers(measurements)]
    lines += ["", "First frames of the first run (what the paper's first measurement has in it):"]
    for m in measurements:
        if m.target.kind == GPU and m.size == min(o.size for o in measurements) and m.members == 1:
            first, last = m.first_frames[0][0], m.first_frames[0][-1]
            lines.append(
                f"{m.target.name}, {m.precision}, method {m.method}, {scene_name(m)}: made in "
                f"{1e3 * m.setup[0]:.4g} ms, then {1e6 * first:.4g} us a step in the first frame, "
                f"{1e6 * last:.4g} in frame {len(m.first_frames[0])}"
            )
    return "\n".join(lines)


def write_tables(measurements: Sequence[Measurement], folder: Path, name: str) -> list[Path]:
    """`name`.csv and `name`_first_frames.csv in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        write_csv(folder / f"{name}.csv", rows(measurements)),
        write_csv(folder / f"{name}_first_frames.csv", first_frames(measurements)),
    ]


def write(measurements: Sequence[Measurement], folder: Path, name: str) -> list[Path]:
    """The tables and, with matplotlib, `name`.png in `folder`."""
    files = write_tables(measurements, folder, name)
    try:
        files.append(figure.draw(measurements, folder / f"{name}.png"))
    except ImportError:
        pass  # the figures are in the CSV files
    return files
