"""Pictures: error against cost, and error against time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.plots import BLACK, BLUE, GREY, name_lines, shown_axes, style
from .methods import OWN

if TYPE_CHECKING:
    from .order import Convergence

_DASHES = {"double": "-", "single": ":"}
_SIZE = 13.0, 6.4


def draw_work_precision(data: Any, ax: Any = None) -> Any:
    """Draw on two matplotlib axes, or on those of a new figure: error against wall time, and against force evaluations.

    A method has a colour and a marker, hollow where it runs at tolerances; "single" is dotted, other libraries dashed.
    """
    panels = shown_axes(ax, 2, *_SIZE, sharey=True)
    bases = [str(name).removesuffix(" adaptive") for name in data["integrator"].values]
    places = {name: k for k, name in enumerate(dict.fromkeys(bases))}
    for m, label in enumerate(map(str, data["solver"].values)):
        one = data.isel(solver=m)
        own = str(one["library"].values) == OWN
        style_of_line = {**style(places[bases[m]]), "lw": 1.2}
        style_of_line["ls"] = _DASHES[str(one["precision"].values)] if own else "--"
        if str(one["control"].values) == "rtol":
            style_of_line["mfc"] = "white"
        rms = np.where(np.isfinite(one["rms_error"]), one["rms_error"], np.nan)
        if np.isfinite(rms).any():
            panels[0].plot(one["wall_time"], rms, **style_of_line)
            panels[1].plot(one["force_evaluations"], rms, label=label, **style_of_line)
    front = data["pareto"].values
    order = np.argsort(data["wall_time"].values[front])
    times, errors = (data[name].values[front][order] for name in ("wall_time", "rms_error"))
    wide = {"color": BLACK, "lw": 5, "alpha": 0.15, "marker": "o", "ms": 11, "zorder": 0}
    panels[0].plot(times, errors, label="front of clothsim", drawstyle="steps-post", **wide)
    texts = ("wall time per simulated second [s/s]", "force evaluations")
    for panel, text in zip(panels, texts, strict=True):
        panel.set(xscale="log", yscale="log", xlabel=text)
    floor = data.attrs["reference_error_estimate_rms"]
    if floor > 0:
        for panel in panels:
            panel.axhline(floor, color=GREY, lw=0.8)
        where = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "bottom", "fontsize": 8}
        panels[1].annotate("error of the reference", (1, floor), color=GREY, **where)
    panels[0].set_ylabel(f"rms error after {data.attrs['duration']:g} s [m]")
    panels[0].legend(fontsize="small", frameon=False)
    name_lines(panels[1])
    return np.array(panels)


def draw_convergence(found: Convergence, ax: Any = None) -> Any:
    """`Convergence.plot`."""
    (axes,) = shown_axes(ax)
    good = np.isfinite(found.rms) & (found.rms > 0)
    axes.loglog(found.dt[good], found.rms[good], color=BLUE, marker="o", label=f"{found.integrator}, {found.precision}")
    outside = good & ~found.fitted
    axes.loglog(found.dt[outside], found.rms[outside], "o", color=BLUE, mfc="white", label="not fitted", zorder=3)
    if found.fitted.sum() > 1:
        dt, middle = found.dt[found.fitted], np.log(found.rms[found.fitted] / found.dt[found.fitted] ** found.order).mean()
        axes.loglog(dt, np.exp(middle) * dt**found.order, color=BLACK, ls="--", label=f"order {found.order:.2f}", zorder=1)
    axes.loglog(found.dt, found.floor, color=BLACK, ls=":", label="floor of the comparison", zorder=1)
    unstable = found.dt[np.isinf(found.rms)]
    if unstable.size:
        top = axes.get_xaxis_transform()
        axes.plot(unstable, np.full(unstable.size, 0.97), "x", color=BLUE, transform=top, label="unstable")
    axes.set(xlabel="time step dt [s]", ylabel=f"rms error after {found.reference.t[-1]:g} s [m]")
    axes.legend(fontsize="small", frameon=False)
    return axes
