"""Curves of a run as one figure of matplotlib."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ..base.extras import needed
from ..base.progress import ProgressBar
from .curves import PARTS, curves
from .picture import file_path

# Okabe and Ito's palette, which readers with any colour vision tell apart; dashes repeat the message.
STYLES: dict[str, dict[str, Any]] = {
    "total": {"color": "#000000", "ls": "-", "lw": 2.0},
    "kinetic": {"color": "#D55E00", "ls": "--"},
    "elastic": {"color": "#009E73", "ls": "-."},
    "gravity": {"color": "#0072B2", "ls": ":", "lw": 2.0},
    "points": {"color": "#0072B2", "ls": "-"},
    "triangles": {"color": "#D55E00", "ls": "--"},
    "stretch": {"color": "#000000", "ls": "-"},
    "contacts": {"color": "#000000", "ls": "-"},
}
PANELS = (
    ("energy [J]", 1.0, ("total", "kinetic", "elastic", "gravity")),
    ("largest stretch [%]", 100.0, ("stretch",)),
    ("penetration [mm]", 1000.0, ("points", "triangles")),
    ("points in contact", 1.0, ("contacts",)),
)
LABELS = {"points": "deepest point", "triangles": "deepest triangle"}


def plot(run: Any, path: str | Path | None = None, progress: bool = False) -> Any:
    """`Run.plot`: the figure, for a notebook. It is also written to `path` if a path is given.

    With `progress`, a bar counts frames.
    """
    what = "run.plot"
    base = needed("matplotlib.figure", what, "plot").Figure
    canvas = needed("matplotlib.backends.backend_agg", what, "plot").FigureCanvasAgg
    path = None if path is None else file_path("path", path)

    class Plot(base):  # type: ignore[misc, valid-type]
        """A figure that a notebook shows without a choice of a backend."""

        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, dpi=100)
            return file.getvalue()

    with ProgressBar(progress, total=PARTS * len(run.t), unit="frame", desc="curves") as bar:
        found = curves(run, bar.advance)
    panels = [panel for panel in PANELS if panel[2][0] in found]
    figure = Plot(figsize=(8, 0.8 + 1.6 * len(panels)), layout="constrained")
    canvas(figure)
    axes = figure.subplots(len(panels), 1, sharex=True)
    few: dict[str, Any] = {"marker": "o", "ms": 3} if len(run.t) < 20 else {}
    for axis, (label, scale, names) in zip(axes, panels, strict=True):
        for name in names:
            style = {"label": LABELS.get(name, name), **STYLES[name], **few}
            axis.plot(run.t, scale * found[name], clip_on=False, **style)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        axis.margins(x=0)
        axis.spines[["top", "right"]].set_visible(False)
        if len(names) > 1:
            axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        if not np.any(found[names[0]] < 0):
            axis.set_ylim(bottom=0)
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    if path is not None:
        figure.savefig(path, dpi=150)
    return figure
