"""Errors over time steps, and the order that they show: the plot of `convergence`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .style import BLACK, HOLLOW, axes_to_show
from .work_precision import style_of_method

if TYPE_CHECKING:
    from ...accuracy.order import Convergence


def draw_convergence(result: Convergence, ax: Any = None) -> Any:
    """Draw `Convergence.plot`."""
    (axes,) = axes_to_show(ax)
    look = style_of_method(result.integrator)
    dt = result.dt
    good = np.isfinite(result.rms) & (result.rms > 0)
    label = f"{result.integrator}, {result.precision}"
    axes.loglog(dt[good], result.rms[good], label=label, **look)
    outside = good & ~result.fitted
    if outside.any():
        hollow = {**look, **HOLLOW}
        axes.loglog(dt[outside], result.rms[outside], label="not fitted", **hollow)
    if result.fitted.sum() > 1:
        powers = dt[result.fitted] ** result.order
        factor = np.exp(np.log(result.rms[result.fitted] / powers).mean())
        label = f"order {result.order:.2f}"
        line = {"color": BLACK, "ls": "--", "zorder": 1}
        axes.loglog(dt[result.fitted], factor * powers, label=label, **line)
    line = {"color": BLACK, "ls": ":", "zorder": 1}
    axes.loglog(dt, result.floor, label="floor of the comparison", **line)
    unstable = dt[np.isinf(result.rms)]
    if unstable.size:
        crosses = {"color": look["color"], "transform": axes.get_xaxis_transform()}
        axes.plot(unstable, np.full(unstable.size, 0.97), "x", label="unstable", **crosses)
    end = result.reference.t[-1]
    axes.set(xlabel="time step dt [s]", ylabel=f"rms error after {end:g} s [m]")
    axes.legend(fontsize="small", frameon=False)
    return axes
