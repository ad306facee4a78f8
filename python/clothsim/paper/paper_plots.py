"""Plots: depth and contact energy over the frames, and the counterparts of Figures 9 and 10."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.plots import BLUE, GREY, RED, figure, save
from . import published as paper
from .responses import Case, Experiment

COLORS = {1: RED, 2: BLUE}
STYLES = {"as printed": "--", "corrected": "-"}
LINEAR_ENERGY = 100.0  # J; above it the energy axis is logarithmic
SHALLOWEST = 1e-3  # mm; the bottom of the depth axis, where no penetration is drawn


def history(experiment: Experiment, cases: Sequence[Case], folder: Path) -> str:
    """Deepest triangle and cumulated contact energy, frame by frame."""
    drawn, ((depth,), (energy,)) = figure(8, 5.2, 2, sharex=True)
    for case in cases:
        look = {"color": COLORS[case.method], "ls": STYLES[case.variant]}
        frames = case.history["frame"]
        triangles = np.maximum(1e3 * np.array(case.history["triangles"]), SHALLOWEST)
        depth.plot(frames, triangles, **look, label=f"method {case.method}, {case.variant}")
        energy.plot(frames, case.history["contact_energy"], **look)
    for panel in (depth, energy):
        for frame in experiment.frames:
            panel.axvline(frame, color=GREY, lw=0.8, zorder=0)
    depth.set(yscale="log", ylim=(SHALLOWEST, None), ylabel="deepest triangle [mm]")
    depth.legend(ncols=4, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0))
    energy.set(ylabel="contact energy [J]", xlabel="frame (grey: those of the paper's table)")
    energies = (abs(value) for case in cases for value in case.history["contact_energy"])
    if max(energies, default=0.0) > LINEAR_ENERGY:
        energy.set_yscale("symlog", linthresh=LINEAR_ENERGY)
        energy.set_ylim(bottom=-LINEAR_ENERGY)
    name = f"{experiment.table}_history.png"
    save(drawn, folder / name)
    return name


def methods(result: dict[str, Any], folder: Path) -> str:
    """Experiment 3 as Figure 9: frames/s of each window, the spread over runs as bars."""
    drawn, ((panel,),) = figure(8, 3.8)
    for row in result["rows"]:
        windows = row["windows"]
        middle, low, high = (
            np.array([w[name] for w in windows]) / result["frame_steps"]
            for name in ("steps_per_second", "lower_quartile", "upper_quartile")
        )
        panel.errorbar(
            np.arange(1, len(windows) + 1) + 0.04 * (row["method"] - 1.5),
            middle,
            yerr=[middle - low, high - middle],
            marker="o",
            capsize=4,
            color=COLORS[row["method"]],
            label=f"method {row['method']}",
        )
    panel.set(
        xlabel=f"window of {result['window_frames']} frames",
        ylabel=f"frames/s\n(a frame is {result['frame_steps']} steps)",
        xticks=range(1, len(windows) + 1),
        yscale="log",
    )
    steps = panel.secondary_yaxis(
        "right", functions=(lambda f: f * result["frame_steps"], lambda s: s / result["frame_steps"])
    )
    steps.set_ylabel("steps/s")
    panel.axhline(
        paper.FRAMES_PER_SECOND / result["frame_steps"],
        color=GREY,
        ls=":",
        label=f"{paper.FRAMES_PER_SECOND} steps/s: the paper's frames/s, one step each",
    )
    panel.legend(fontsize="small", loc="center")
    save(drawn, folder / "figure9.png")
    return "figure9.png"


def speedup(result: dict[str, Any], folder: Path) -> str:
    """Experiment 4 as the CPU side of Figure 10: steps/s of each run."""
    drawn, ((panel,),) = figure(8, 3.8)
    for row in result["rows"]:
        runs = range(1, len(row["runs"]) + 1)
        threads = f"{row['threads']} thread{'s' if row['threads'] > 1 else ''}"
        label = f"{row['kind']}, {row['precision']}, {threads} ({row['speedup']:.1f}x)"
        panel.plot(runs, row["runs"], marker="o", ms=4, label=label)
    panel.set(xlabel="run", ylabel="steps/s", yscale="log", xticks=runs)
    panel.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(drawn, folder / "figure10.png")
    return "figure10.png"
