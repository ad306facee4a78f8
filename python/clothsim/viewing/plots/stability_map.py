"""The map of `stability_map`: stable and unstable runs, and the predicted and guaranteed limit."""

from __future__ import annotations

from typing import Any

import numpy as np

from .style import BLACK, BLUE, RED, shown_axes


def draw_map(data: Any, ax: Any = None) -> Any:
    """Draw stable and unstable runs over stiffness and time step, and lines of both limits."""
    (axes,) = shown_axes(ax, width=7, height=5)
    stable = data["stable"].transpose("stiffness", "dt").values
    predicted = data["predicted"].transpose("stiffness", "dt").values
    k, dt = np.meshgrid(data["stiffness"], data["dt"], indexing="ij")
    for mask, color, marker, label in (
        (stable, BLUE, "o", "stable"),
        (~stable, RED, "x", "unstable"),
    ):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    rising = data.sortby("stiffness")
    for name, dash, label in (
        ("limit", "-", "predicted at the start"),
        ("guarantee", "--", "guaranteed"),
    ):
        if np.isfinite(rising[name]).any():
            axes.plot(rising["stiffness"], rising[name], dash, color=BLACK, label=label)
    title = "{integrator}, {precision}: {steps} steps".format_map(data.attrs)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=title,
    )
    if (~stable & predicted).any():
        note = (
            "Crosses below the predicted limit: it is that of the initial state, and the cloth "
            "moves on to others"
        )
        axes.text(
            0.5, 1.0, note, transform=axes.transAxes, ha="center", va="bottom", fontsize="small"
        )
        axes.set_title(title, pad=20)
    axes.figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return axes
