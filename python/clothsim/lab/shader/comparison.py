"""Findings of experiment 4: the faster target, the size from which it is faster, and shortened windows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .measurement import GPU, Measurement

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


def shortened(measurements: Sequence[Measurement]) -> list[str]:
    """Which windows were ended early, in a sentence; empty if none was."""
    some = [m for m in measurements if m.shortened]
    if not some:
        return []
    limits = sorted({m.limit for m in some})
    return [
        f"* {len(some)} of {len(measurements)} measurements are means over fewer steps than asked: "
        f"their windows were ended after {' or '.join(f'{limit:g}' for limit in limits)} s. "
        f"The shortest held {min(min(m.steps) for m in some):,} of {some[0].asked:,} steps."
    ]


def scene_name(m: Measurement) -> str:
    """The size of a scene, and how many cloths it has."""
    return f"{m.size} x {m.size}" + (f", {m.members} cloths" if m.members > 1 else "")


def by_table(measurements: Sequence[Measurement]) -> dict[tuple[str, int], list[Measurement]]:
    """By precision and method."""
    tables: dict[tuple[str, int], list[Measurement]] = {}
    for m in measurements:
        tables.setdefault((m.precision, m.method), []).append(m)
    return tables
