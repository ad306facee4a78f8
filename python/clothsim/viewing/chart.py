"""Curves of a run as one figure of matplotlib."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ..base.extras import needed
from ..base.plots import BLACK, BLUE, DPI, GREEN, RED, figure, save
from ..base.progress import ProgressBar
from .curves import PARTS, curves
from .picture import file_path

# Dashes repeat the message of the colours.
STYLES: dict[str, dict[str, Any]] = {
    "total": {"color": BLACK, "ls": "-", "lw": 2.0},
    "kinetic": {"color": RED, "ls": "--"},
    "elastic": {"color": GREEN, "ls": "-."},
    "gravity": {"color": BLUE, "ls": ":", "lw": 2.0},
    "points": {"color": BLUE, "ls": "-"},
    "triangles": {"color": RED, "ls": "--"},
    "stretch": {"color": BLACK, "ls": "-"},
    "contacts": {"color": BLACK, "ls": "-"},
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
    path = None if path is None else file_path("path", path)
    formats = base().canvas.get_supported_filetypes()
    if path is not None and path.suffix.lower()[1:] not in formats:
        raise ValueError(f"path must end in one of {', '.join(f'.{name}' for name in formats)}, got {str(path)!r}")

    class Plot(base):  # type: ignore[misc, valid-type]
        """A figure that a notebook shows without a choice of a backend."""

        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, dpi=DPI)
            return file.getvalue()

    with ProgressBar(progress, total=PARTS * len(run.t), unit="frame", desc="curves") as bar:
        found = curves(run, bar.advance)
    panels = [panel for panel in PANELS if panel[2][0] in found]
    drawn, axes = figure(8, 0.8 + 1.6 * len(panels), len(panels), what=what, base=Plot, sharex=True)
    few: dict[str, Any] = {"marker": "o", "ms": 3} if len(run.t) < 20 else {}
    for axis, (label, scale, names) in zip(axes[:, 0], panels, strict=True):
        for name in names:
            style = {"label": LABELS.get(name, name), **STYLES[name], **few}
            axis.plot(run.t, scale * found[name], clip_on=False, **style)
        axis.set_ylabel(label)
        axis.margins(x=0)
        if len(names) > 1:
            axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        if not np.any(found[names[0]] < 0):
            axis.set_ylim(bottom=0)
    axes[-1, 0].set_xlabel("time [s]")
    drawn.align_ylabels()
    if path is not None:
        save(drawn, path)
    return drawn
