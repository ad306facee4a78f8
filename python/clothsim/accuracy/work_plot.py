"""Pictures: error against cost, and error against time step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..base.plots import BLACK, GREY, figure, save
from .methods import OWN

_STYLES = {"double": "-", "single": ":"}
_MARKERS = {"dt": "o", "rtol": "s"}


def plot_work_precision(data: Any, path: str | Path) -> Path:
    """Error against wall time and against force evaluations, with the Pareto front marked.

    Parameters
    ----------
    data : xarray.Dataset
        From `work_precision`.
    path : path-like
        Picture to write, of a format that matplotlib knows.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    ImportError
        Without matplotlib, naming the extra that brings it.
    """
    colormaps = needed("matplotlib", "a picture", "plot").colormaps
    path = check.path("path", path)
    drawn, (panels,) = figure(13, 6.4, 1, 2, sharey=True)
    names = list(dict.fromkeys(map(str, data["integrator"].values)))
    colors = {name: colormaps["tab20"](k % 20) for k, name in enumerate(names)}
    for m, label in enumerate(map(str, data["solver"].values)):
        one = data.isel(solver=m)
        own = str(one["library"].values) == OWN
        style = {
            "color": colors[str(one["integrator"].values)],
            "ls": _STYLES[str(one["precision"].values)] if own else "--",
            "marker": _MARKERS[str(one["control"].values)] if own else "x",
            "ms": 4,
            "lw": 1.2,
        }
        rms = np.where(np.isfinite(one["rms_error"]), one["rms_error"], np.nan)
        if np.isfinite(rms).any():
            panels[0].plot(one["wall_time"], rms, label=label, **style)
            panels[1].plot(one["force_evaluations"], rms, **style)
    front = data["pareto"].values
    order = np.argsort(data["wall_time"].values[front])
    panels[0].plot(
        data["wall_time"].values[front][order],
        data["rms_error"].values[front][order],
        color=BLACK,
        lw=5,
        alpha=0.15,
        marker="o",
        ms=11,
        label="front of clothsim",
        zorder=0,
        drawstyle="steps-post",
    )
    texts = ("wall time per simulated second [s/s]", "force evaluations")
    for panel, text in zip(panels, texts, strict=True):
        panel.set(xscale="log", yscale="log", xlabel=text)
    floor = data.attrs["reference_error_estimate_rms"]
    if floor > 0:
        for panel in panels:
            panel.axhline(floor, color=GREY, lw=0.8)
        panels[1].annotate(
            "error of the reference",
            (1, floor),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom",
            fontsize=8,
            color=GREY,
        )
    panels[0].set_ylabel(f"rms error after {data.attrs['duration']:g} s [m]")
    drawn.legend(loc="outside right upper", fontsize=8, frameon=False)
    save(drawn, path)
    return path
