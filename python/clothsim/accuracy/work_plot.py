"""Pictures: error against cost, error against time step, and a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.plots import BLACK, BLUE, COLORS, GREY, name_lines, shown_axes, style
from .methods import OWN

if TYPE_CHECKING:
    from .fit import Fit
    from .order import Convergence

_DASHES = {"double": "-", "single": ":"}
_SIZE = 13.0, 6.4
_SIZE_OF_FIT = 13.0, 4.2


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


_SHOWN = 3  # points of the data


def draw_fit(found: Fit, ax: Any = None) -> Any:
    """`Fit.plot`."""
    curves, off, matrix = shown_axes(ax, 3, *_SIZE_OF_FIT)
    data = found.positions.reshape(len(found.times), -1, 3)
    residuals = found.residuals.reshape(data.shape)
    spread = np.nan_to_num(np.nanmax(data, axis=0) - np.nanmin(data, axis=0))
    for n, k in enumerate(np.argsort(-spread.max(axis=1), kind="stable")[:_SHOWN]):
        c, place = int(spread[k].argmax()), tuple(map(int, np.unravel_index(k, found.positions.shape[1:-1])))
        label = f"{'xyz'[c]} of point {place if len(place) > 1 else f'number {k}'}"
        curves.plot(found.times, data[:, k, c], "o", ms=4, color=COLORS[n], label=label)
        curves.plot(found.times, data[:, k, c] - residuals[:, k, c], "-", color=COLORS[n])
    curves.set(xlabel="time [s]", ylabel="position [m]", title="measured (dots) and fitted")
    curves.legend(fontsize="small")
    off.plot(found.times, residuals.reshape(len(found.times), -1) * 1e3, ".", ms=3, color=BLUE, alpha=0.5)
    for side in (-1, 1):
        off.axhline(side * 2e3 * found.report["sigma"], color=GREY, ls="--")
    off.set(xlabel="time [s]", ylabel="measured less fitted [mm]", title="residuals; dashed: 2 sigma")
    names, deviation = [*found.values], np.sqrt(np.diag(found.covariance))
    correlation = found.covariance / np.outer(deviation, deviation)
    matrix.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    for i, j in np.argwhere(np.isfinite(correlation)):
        color = "white" if abs(correlation[i, j]) > 0.6 else BLACK
        matrix.text(j, i, f"{correlation[i, j]:.2f}", ha="center", va="center", fontsize=8, color=color)
    labels = [name if np.isfinite(found.values[name]) else f"{name} (unknown)" for name in names]
    matrix.set_xticks(range(len(names)), labels, rotation=30, ha="right")
    matrix.set_yticks(range(len(names)), labels)
    matrix.set_title("correlation of the parameters")
    matrix.grid(False)
    return np.array([curves, off, matrix])
