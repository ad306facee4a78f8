"""Pictures: error against cost, error against time step, and a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.plots import BLACK, BLUE, COLORS, GREY, label_lines, shown_axes, style
from ..methods.integrators import integrators

if TYPE_CHECKING:
    from .fit import Fit
    from .work import Convergence

OWN = "clothsim"  # library of the integrators
_DASHES = {("dt", "double"): "-", ("dt", "single"): ":", ("rtol", "double"): "-.", ("rtol", "single"): (0, (7, 2, 1, 2))}
_HOLLOW = {"mfc": "white", "ls": "none", "zorder": 3}


def look_of(method: str, others: Sequence[str] = ()) -> dict[str, Any]:
    """Colour and marker of a method, the same in every plot; methods of others follow those of this package."""
    names = [*integrators(), *others, method]
    return {**style(names.index(method)), "ls": "-", "lw": 1.2}


def draw_work_precision(data: Any, ax: Any = None) -> Any:
    """Draw error against wall time, and against force evaluations, on two matplotlib axes, given or new.

    With one given axes, draw only against wall time. Each method has the same colour and marker in every plot. Methods at
    tolerances are dash-dotted, "single" has more dots, other libraries are dashed. Points below the error
    of the reference are hollow.
    """
    panels = shown_axes(ax, 1 if np.size(ax) == 1 and ax is not None else 2, 13.0, 6.4, sharey=True)
    own, precisions = integrators(), set(data["precision"].values[data["library"].values == OWN])
    methods = [str(name).removesuffix(" adaptive") for name in data["integrator"].values]
    others = list(dict.fromkeys(name for name in methods if name not in own))
    floor = data.attrs["reference_error_estimate_rms"]
    for m, label in enumerate(map(str, data["solver"].values)):
        one, look = data.isel(solver=m), look_of(methods[m], others)
        kind = str(one["control"].values), str(one["precision"].values)
        look["ls"] = _DASHES[kind] if str(one["library"].values) == OWN else "--"
        if len(precisions) == 1:
            label = label.removesuffix(f" {next(iter(precisions))}")
        rms = np.where(np.isfinite(one["rms_error"]), one["rms_error"], np.nan)
        if np.isfinite(rms).any():
            for panel, cost in zip(panels, ("wall_time", "force_evaluations")):
                panel.plot(one[cost], rms, label=label, **look)
                panel.plot(one[cost][rms < floor], rms[rms < floor], **{**look, **_HOLLOW})
    front = data["pareto"].values
    order = np.argsort(data["wall_time"].values[front])
    times, errors = (data[name].values[front][order] for name in ("wall_time", "rms_error"))
    wide = {"color": BLACK, "lw": 5, "alpha": 0.15, "marker": "o", "ms": 11, "zorder": 0}
    panels[0].plot(times, errors, drawstyle="steps-post", **wide)
    texts = (f"wall time per simulated second [s/s]{'; grey: front' if front.any() else ''}", "force evaluations")
    for panel, text in zip(panels, texts):
        panel.set(xscale="log", yscale="log", xlabel=text)
        if floor > 0:
            panel.axhline(floor, color=GREY, lw=0.8)
            # At the left: where a method is fast, its error is not yet that small.
            where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "fontsize": 8}
            panel.annotate("error of the reference", (0.01, floor), color=GREY, **where)
        low, high = panel.get_xlim()
        panel.set_xlim(low, high * (high / low) ** 0.3)  # room for labels
    panels[0].set_ylabel(f"rms error after {data.attrs['duration']:g} s [m]")
    for panel in panels:
        label_lines(panel)
    return np.array(panels)


def draw_convergence(found: Convergence, ax: Any = None) -> Any:
    """`Convergence.plot`."""
    (axes,) = shown_axes(ax)
    look = look_of(found.integrator)
    good = np.isfinite(found.rms) & (found.rms > 0)
    axes.loglog(found.dt[good], found.rms[good], label=f"{found.integrator}, {found.precision}", **look)
    outside = good & ~found.fitted
    axes.loglog(found.dt[outside], found.rms[outside], label="not fitted", **{**look, **_HOLLOW})
    if found.fitted.sum() > 1:
        dt, middle = found.dt[found.fitted], np.log(found.rms[found.fitted] / found.dt[found.fitted] ** found.order).mean()
        axes.loglog(dt, np.exp(middle) * dt**found.order, color=BLACK, ls="--", label=f"order {found.order:.2f}", zorder=1)
    axes.loglog(found.dt, found.floor, color=BLACK, ls=":", label="floor of the comparison", zorder=1)
    unstable = found.dt[np.isinf(found.rms)]
    if unstable.size:
        top = axes.get_xaxis_transform()
        axes.plot(unstable, np.full(unstable.size, 0.97), "x", color=look["color"], transform=top, label="unstable")
    axes.set(xlabel="time step dt [s]", ylabel=f"rms error after {found.reference.t[-1]:g} s [m]")
    axes.legend(fontsize="small", frameon=False)
    return axes


def draw_fit(found: Fit, ax: Any = None) -> Any:
    """`Fit.plot`."""
    curves, off, matrix = shown_axes(ax, 3, 13.0, 4.2)
    data = found.positions.reshape(len(found.times), -1, 3)
    residuals = found.residuals.reshape(data.shape)
    spread = np.nan_to_num(np.nanmax(data, axis=0) - np.nanmin(data, axis=0))
    for n, k in enumerate(np.argsort(-spread.max(axis=1), kind="stable")[:3]):
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
