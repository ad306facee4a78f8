"""Stability for people: the map as a table, a picture and a CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..base.plots import BLACK, BLUE, RED, figure, save, shown_axes
from ..base.table import aligned
from .map import StabilityMap


def map_table(found: StabilityMap) -> str:
    """Table with a row per time step and a column per stiffness: ``o`` is stable, ``x`` is not. Cells are marked where
    the prediction differs.
    """
    header = ["dt [s] \\ K [N/m]", *(f"{k:.2g}" for k in found.stiffness)]
    lines = []
    for j in np.argsort(found.dt)[::-1]:
        marks = ("o" if s else "x" for s in found.stable[:, j])
        agree = (m if s == p else m + "!" for m, s, p in zip(marks, found.stable[:, j], found.predicted[:, j]))
        lines.append([f"{found.dt[j]:.3e}", *agree])
    lines.append(["predicted limit", *(f"{h:.2e}" for h in found.limit)])
    lines.append(["guaranteed", *(f"{h:.2e}" for h in found.guarantee)])
    differing = int((found.stable != found.predicted).sum())
    return (
        f"{aligned(header, lines)}\n"
        f"o stable, x unstable over {found.steps} steps of {found.integrator} in {found.precision}; "
        f"! where the prediction differs: {differing} of {found.stable.size} cells"
    )


def map_rows(found: StabilityMap) -> list[dict[str, Any]]:
    """One row per cell, for a CSV file."""
    return [
        {
            "stiffness": float(k),
            "dt": float(dt),
            "stable": int(found.stable[i, j]),
            "predicted": int(found.predicted[i, j]),
            "limit": found.limit[i],
            "guarantee": found.guarantee[i],
        }
        for i, k in enumerate(found.stiffness)
        for j, dt in enumerate(found.dt)
    ]


def plot_map(found: StabilityMap, path: Path) -> None:
    """Write the picture of `draw_map`."""
    drawn, axes = figure(7, 5)
    draw_map(found, axes)
    save(drawn, path)


def draw_map(found: StabilityMap, ax: Any = None) -> Any:
    """Draw stable and unstable runs, with lines of the predicted limit and the guarantee, and return the axes."""
    (axes,) = shown_axes(ax, width=7, height=5)
    k, dt = np.meshgrid(found.stiffness, found.dt, indexing="ij")
    for mask, color, marker, label in ((found.stable, BLUE, "o", "stable"), (~found.stable, RED, "x", "unstable")):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    order = np.argsort(found.stiffness)
    for values, style, label in (
        (found.limit, "-", "predicted limit"),
        (found.guarantee, "--", "guaranteed (max_stable_dt)"),
    ):
        if np.isfinite(values).any():
            axes.plot(found.stiffness[order], values[order], style, color=BLACK, label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=f"{found.integrator}, {found.precision}: {found.steps} steps",
    )
    axes.figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return axes
