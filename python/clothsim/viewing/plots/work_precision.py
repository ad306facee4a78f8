"""Error against cost: the plot of `work_precision`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...accuracy.work import OWN
from ...methods.integrators import METHODS
from .style import BLACK, GREY, HOLLOW, axes_to_show, label_lines, line_style

# (control, precision): the dash of a method of this package; others are dashed.
_DASHES = {
    ("dt", "double"): "-",
    ("dt", "single"): ":",
    ("rtol", "double"): "-.",
    ("rtol", "single"): (0, (7, 2, 1, 2)),
}

_NEAR = 1e-3  # of the smallest error, below which the error of the reference is not drawn


def style_of_method(method: str, others: Sequence[str] = ()) -> dict[str, Any]:
    """Return colour and marker of a method, the same in every plot; others' methods follow ours."""
    names = [*METHODS, *others, method]
    return {**line_style(names.index(method)), "ls": "-", "lw": 1.2}


def draw_work_precision(data: Any, ax: Any = None) -> Any:
    """Draw error against wall time, and against force evaluations, on two axes.

    On a single axes of a caller, draw only against wall time. Each method has the same colour and
    marker in every plot. Methods at tolerances are dash-dotted, "single" has more dots, other
    libraries are dashed. Points below the error of the reference are hollow.
    """
    count = 1 if np.size(ax) == 1 and ax is not None else 2
    panels = axes_to_show(ax, count, width=13.0, height=6.4, sharey=True)
    precisions = set(data["precision"].values[data["library"].values == OWN])
    methods = [str(name).removesuffix(" adaptive") for name in data["integrator"].values]
    others = list(dict.fromkeys(name for name in methods if name not in METHODS))
    floor = data.attrs["reference_error_estimate_rms"]
    for m, label in enumerate(map(str, data["solver"].values)):
        solver = data.isel(solver=m)
        look = style_of_method(methods[m], others)
        kind = str(solver["control"].values), str(solver["precision"].values)
        look["ls"] = _DASHES[kind] if str(solver["library"].values) == OWN else "--"
        if len(precisions) == 1:
            label = label.removesuffix(f" {next(iter(precisions))}")
        rms = np.where(np.isfinite(solver["rms_error"]), solver["rms_error"], np.nan)
        if np.isfinite(rms).any():
            unsure = rms < floor
            for panel, cost in zip(panels, ("wall_time", "force_evaluations")):
                panel.plot(solver[cost], rms, label=label, **look)
                panel.plot(solver[cost][unsure], rms[unsure], **{**look, **HOLLOW})
    front = data["pareto"].values
    order = np.argsort(data["wall_time"].values[front])
    times = data["wall_time"].values[front][order]
    errors = data["rms_error"].values[front][order]
    wide = {"color": BLACK, "lw": 5, "alpha": 0.15, "marker": "o", "ms": 11, "zorder": 0}
    panels[0].plot(times, errors, drawstyle="steps-post", **wide)
    note = "\ngrey: front" if front.any() else ""
    texts = (f"wall time [s per simulated s]{note}", "force evaluations")
    smallest = np.where(np.isfinite(data["rms_error"]), data["rms_error"], np.inf).min()
    for panel, text in zip(panels, texts):
        panel.set(xscale="log", yscale="log", xlabel=text)
        if floor > _NEAR * smallest:
            panel.axhline(floor, color=GREY, lw=0.8)
            # The note is at the left: where a method is fast, its error is not yet that small.
            where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "fontsize": 8}
            panel.annotate("error of the reference", (0.01, floor), color=GREY, **where)
        low, high = panel.get_xlim()
        panel.set_xlim(low, high * (high / low) ** 0.3)  # room for labels
    panels[0].set_ylabel(f"rms error after {data.attrs['duration']:g} s [m]")
    for panel in panels:
        label_lines(panel)
    return np.array(panels)
