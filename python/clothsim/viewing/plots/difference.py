"""Distance of two runs over time: the plot of `difference`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...base.text import format_count
from .style import BLUE, FEW, RED, axes_to_show


def draw_difference(result: Mapping[str, Any], ax: Any = None) -> Any:
    """Draw `Difference.plot`."""
    (axes,) = axes_to_show(ax)
    marks: dict[str, Any] = {"marker": "o", "ms": 3} if len(result["t"]) < FEW else {}
    differ = bool((result["max"] > 0).any())
    for key, label, color, dash in (("max", "largest", RED, "-"), ("rms", "rms", BLUE, "--")):
        values = np.where(result[key] > 0, result[key], np.nan) if differ else result[key]
        axes.plot(result["t"], values, label=label, color=color, ls=dash, **marks)
    axes.set(xlabel="time [s]", ylabel="distance of the mass points [m]")
    if differ:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    note = None
    if result["unmatched"]:
        note = f"{format_count(result['unmatched'], 'frame')} without a partner"
    axes.legend(title=note, fontsize="small", title_fontsize="small")
    return axes
