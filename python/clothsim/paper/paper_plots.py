"""Plots: depth and energy over the frames, and the counterparts of Figures 9 and 10."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.plots import BLUE, GREY, RED, figure, name_lines, save, style
from .responses import Case, Experiment

COLORS = {1: RED, 2: BLUE}
STYLES = {"as printed": "--", "corrected": "-"}
LINEAR_ENERGY = 100.0  # J; above it the energy axis is logarithmic
SHALLOWEST = 1e-3  # mm; the bottom of the depth axis, where no penetration is drawn


def history(experiment: Experiment, cases: Sequence[Case], folder: Path) -> str:
    """Deepest triangle and energy gained, frame by frame."""
    drawn, ((depth,), (energy,)) = figure(8, 5.2, 2, sharex=True)
    for case in cases:
        style = {"color": COLORS[case.method], "ls": STYLES[case.variant]}
        frames = case.history["frame"]
        triangles = np.maximum(1e3 * np.array(case.history["triangles"]), SHALLOWEST)
        depth.plot(frames, triangles, **style, label=f"method {case.method}, {case.variant}")
        energy.plot(frames, case.history["energy_gained"], **style)
    for panel in (depth, energy):
        for frame in experiment.frames:
            panel.axvline(frame, color=GREY, lw=0.8, zorder=0)
    depth.set(yscale="log", ylim=(SHALLOWEST, None), ylabel="deepest triangle [mm]")
    depth.legend(ncols=4, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0))
    energy.set(ylabel="energy gained [J]", xlabel="frame (grey: those of the paper's table)")
    energies = (abs(value) for case in cases for value in case.history["energy_gained"])
    if max(energies, default=0.0) > LINEAR_ENERGY:
        energy.set_yscale("symlog", linthresh=LINEAR_ENERGY)
        energy.set_ylim(bottom=-LINEAR_ENERGY)
    name = f"{experiment.table}_history.png"
    save(drawn, folder / name)
    return name


def methods(result: dict[str, Any], folder: Path) -> str:
    """Experiment 3 as Figure 9: frames/s of each window, the spread over runs as bars."""
    drawn, ((panel,),) = figure(8, 3.8)
    for k, row in enumerate(result["rows"]):
        windows = row["windows"]
        middle, low, high = (
            np.array([w[name] for w in windows]) / result["frame_steps"]
            for name in ("steps_per_second", "lower_quartile", "upper_quartile")
        )
        places = np.arange(1, len(windows) + 1) + 0.04 * (row["method"] - 1.5)
        style_of_line = {**style(k), "color": COLORS[row["method"]]}
        panel.plot(places, middle, **style_of_line, label=f"method {row['method']}")
        panel.errorbar(places, middle, [middle - low, high - middle], fmt="none", capsize=4, color=style_of_line["color"])
    panel.set(
        xlabel=f"window of {result['window_frames']} frames",
        ylabel=f"frames/s\n(a frame is {result['frame_steps']} steps)",
        xticks=range(1, len(windows) + 1),
    )
    steps = panel.secondary_yaxis(
        "right", functions=(lambda f: f * result["frame_steps"], lambda s: s / result["frame_steps"])
    )
    steps.set_ylabel("steps/s")
    panel.legend(ncols=2, fontsize="small", frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    save(drawn, folder / "figure9.png")
    return "figure9.png"


def speedup(result: dict[str, Any], folder: Path) -> str:
    """Experiment 4 as the CPU side of Figure 10: steps/s of each run."""
    drawn, ((panel,),) = figure(8, 3.8)
    for k, row in enumerate(result["rows"]):
        runs = range(1, len(row["runs"]) + 1)
        threads = f"{row['threads']} thread{'s' if row['threads'] > 1 else ''}"
        label = f"{row['kind']}, {row['precision']}, {threads} ({row['speedup']:.1f}x)"
        panel.plot(runs, row["runs"], **style(k), label=label)
    panel.set(xlabel="run", ylabel="steps/s", yscale="log", xticks=runs)
    name_lines(panel)
    save(drawn, folder / "figure10.png")
    return "figure10.png"
