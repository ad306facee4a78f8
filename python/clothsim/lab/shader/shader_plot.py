"""The plot of experiment 4 over sizes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from clothsim.base.plots import BLUE, DPI, GREY, RED, figure

from .comparison import by_table, crossover, warnings
from .measurement import GPU, Measurement

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
    drawn.savefig(path, dpi=DPI)
    return path


_STYLES = ("-", "--", ":", "-.")


def _draw_speed(panel: Any, group: list[Measurement], everything: Sequence[Measurement]) -> None:
    styles: dict[str, int] = {}
    for name in dict.fromkeys(m.target.name for m in group):
        mine = [m for m in group if m.target.name == name]
        kind = mine[0].target.kind
        place = styles[kind] = styles.get(kind, -1) + 1
        look = {"color": _COLORS[kind], "ls": _STYLES[place % len(_STYLES)], "ms": 4}
        for batch, marker in ((False, "o"), (True, "s")):
            part = sorted((m for m in mine if (m.members > 1) == batch), key=lambda m: m.points)
            panel.plot(
                [m.points for m in part],
                [m.rate * m.points for m in part],
                marker=marker,
                mfc="white" if batch else _COLORS[kind],
                **look,
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
    panel.legend(fontsize="x-small")


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
