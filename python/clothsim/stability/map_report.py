"""The picture of a stability map."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.plots import BLACK, BLUE, RED, shown_axes
from .map import StabilityMap


def draw_map(found: StabilityMap, ax: Any = None) -> Any:
    """Draw stable and unstable runs, with lines of the predicted limit and the guarantee, and return the axes."""
    (axes,) = shown_axes(ax, width=7, height=5)
    k, dt = np.meshgrid(found.stiffness, found.dt, indexing="ij")
    for mask, color, marker, label in ((found.stable, BLUE, "o", "stable"), (~found.stable, RED, "x", "unstable")):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    order = np.argsort(found.stiffness)
    for values, style, label in ((found.limit, "-", "predicted at the start"), (found.guarantee, "--", "guaranteed")):
        if np.isfinite(values).any():
            axes.plot(found.stiffness[order], values[order], style, color=BLACK, label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=f"{found.integrator}, {found.precision}: {found.steps} steps",
    )
    if (~found.stable & found.predicted).any():
        note = "Crosses below the predicted limit: it is that of the initial state, and the cloth moves on to others"
        axes.text(0.5, 1.0, note, transform=axes.transAxes, ha="center", va="bottom", fontsize="small")
        axes.set_title(axes.get_title(), pad=20)
    axes.figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return axes
