"""Motion and error bounds of a trusted solution: the plot of `reference`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .points import distant_points
from .style import BLUE, COLORS, FEW, MARKERS, RED, axes_to_show

if TYPE_CHECKING:
    from ...accuracy.solution import Reference


def draw_reference(result: Reference, ax: Any = None) -> Any:
    """Draw `Reference.plot`."""
    motion, error = axes_to_show(ax, 2, width=11.0, height=4.4)
    sparse = len(result.t) < FEW
    x = result.x.reshape(len(result.t), -1, 3)
    ways = x - x[0]
    for n, (k, component) in enumerate(distant_points(x)):
        place = tuple(map(int, np.unravel_index(k, result.x.shape[1:-1])))
        label = f"{'xyz'[component]} of point {place}"
        marker = MARKERS[n] if sparse else None
        motion.plot(
            result.t, ways[:, k, component], color=COLORS[n], marker=marker, ms=4, label=label
        )
    motion.set(xlabel="time [s]", ylabel="way from the start [m]", title="the solution")
    motion.legend(fontsize="small")
    for numbers, name, color in (
        (result.error_bound, "bound", BLUE),
        (result.error_estimate, "estimate", RED),
    ):
        for key, text, dash, marker in (("max", "largest", "-", "o"), ("rms", "rms", "--", "s")):
            positive = numbers[key] > 0
            if positive.any():
                look = {"color": color, "ls": dash, "marker": marker if sparse else None, "ms": 4}
                values = np.where(positive, numbers[key], np.nan)
                error.plot(result.t, values, label=f"{name}, {text}", **look)
    error.set(xlabel="time [s]", ylabel="error [m]", title="its error", yscale="log")
    error.set_xlim(motion.get_xlim())
    error.legend(fontsize="small")
    return np.array([motion, error])
