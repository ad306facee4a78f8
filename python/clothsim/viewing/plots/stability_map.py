"""The map of `stability_map`: stable and unstable runs, and the predicted and guaranteed limit."""

from __future__ import annotations

from typing import Any

import numpy as np

from .style import BLACK, BLUE, RED, axes_to_show, put_legend_beside, separate_ticks, wrap_text


def draw_map(data: Any, ax: Any = None) -> Any:
    """Draw stable and unstable runs over stiffness and time step, and lines of both limits."""
    (axes,) = axes_to_show(ax, width=7, height=5)
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
        ("limit", "-", "predicted\nat the start"),
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
        note = wrap_text(
            "Crosses below the predicted limit: it is that of the initial state, and the cloth "
            "moves on to others",
            axes,
        )
        look = {"ha": "center", "va": "bottom", "fontsize": "small"}
        axes.text(0.5, 1.0, note, transform=axes.transAxes, **look)
        axes.set_title(title, pad=8 + 12 * (1 + note.count("\n")))
    put_legend_beside(axes)
    separate_ticks(axes)
    return axes
