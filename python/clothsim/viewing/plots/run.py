"""Curves of a run over its frames, and the figure of `Run.plot`."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ...base import Floats
from ...base.extras import import_from_extra
from ...base.files import replace_when_complete
from ...model.scene import Scene
from ..picture import check_file_path
from .style import BLACK, BLUE, DPI, FEW, GREEN, RED, put_legend_beside, tidy_axes

# A mass point touches a sphere if it is closer than the contact radius and this part of the
# spacing. Half of it misses points that bounce while they rest, twice of it counts points that only
# pass.
TOUCH = 1 / 32


def count_touching_points(scene: Scene, x: Floats, t: float) -> int:
    """Return the number of mass points that touch a sphere or are in its layer at the time `t`."""
    touched = np.zeros(scene.cloth.shape, bool)
    for sphere in scene.spheres:
        near = TOUCH * max(scene.cloth.spacing)
        if sphere.response == "penalty":
            near = sphere.layer(scene.cloth)["thickness"]
        touched |= sphere.height(x, t) <= sphere.offset_length(scene.cloth) + near
    return int(touched.sum())


def curves_over_frames(run: Any) -> dict[str, Floats]:
    """Return each curve, shape (frames,).

    "kinetic", "elastic", "gravity", "force" and "total" [J]; "stretch" of the most stretched
    spring, l/L - 1; "points" and "triangles", the deepest of each below the true radius of any
    sphere [m]; "contacts", the number of mass points that touch a sphere. Without a sphere the last
    three are missing.
    """
    values: dict[str, Floats] = {**run.energy(), "stretch": run.stretch()["largest"]}
    if run.scene.spheres:
        values |= run.penetration()
        counts = [count_touching_points(run.scene, x, float(t)) for x, t in zip(run.x, run.t)]
        values["contacts"] = np.array(counts, float)
    return values


# Name of a curve: colour, dash (which repeats the message of the colour), width.
STYLES = {
    "total": (BLACK, "-", 2.0),
    "kinetic": (RED, "--", 1.5),
    "elastic": (GREEN, "-.", 1.5),
    "gravity": (BLUE, ":", 2.0),
    "points": (BLUE, "-", 1.5),
    "triangles": (RED, "--", 1.5),
}
PANELS = (
    ("energy [J]", 1.0, ("total", "kinetic", "elastic", "gravity")),
    ("largest stretch [%]", 100.0, ("stretch",)),
    ("penetration [mm]", 1000.0, ("points", "triangles")),
    ("points in contact", 1.0, ("contacts",)),
)
LABELS = {"points": "deepest point", "triangles": "deepest triangle"}


def draw_run(run: Any, path: str | Path | None = None) -> Any:
    """Return the figure of `Run.plot`, which a notebook shows; write it to a `path` too."""
    base = import_from_extra("matplotlib.figure", "run.plot", "plot").Figure
    path = None if path is None else check_file_path("path", path)
    formats = base().canvas.get_supported_filetypes()
    if path is not None and path.suffix.lower()[1:] not in formats:
        raise ValueError(
            f"path must end in one of {', '.join(f'.{name}' for name in formats)}, got "
            f"{str(path)!r}"
        )

    class Plot(base):  # type: ignore[misc, valid-type]
        """A figure that a notebook shows without a choice of a backend."""

        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, dpi=DPI)
            return file.getvalue()

    values = curves_over_frames(run)
    panels = [panel for panel in PANELS if panel[2][0] in values]
    figure = Plot(figsize=(8, 0.8 + 1.6 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), squeeze=False, sharex=True)
    marks: dict[str, Any] = {"marker": "o", "ms": 3} if len(run.t) < FEW else {}
    for panel, (label, scale, names) in zip(axes[:, 0], panels, strict=True):
        tidy_axes(panel)
        for name in names:
            color, dash, width = STYLES.get(name, (BLACK, "-", 1.5))
            text = LABELS.get(name, name)
            look = {"label": text, "color": color, "ls": dash, "lw": width, **marks}
            panel.plot(run.t, scale * values[name], clip_on=False, **look)
        panel.set(ylabel=label, xmargin=0)
        if not any((values[name] < 0).any() for name in names):
            panel.set_ylim(bottom=0)
        if len(names) > 1:
            put_legend_beside(panel)
    axes[-1, 0].set_xlabel("time [s]")
    figure.align_ylabels()
    if path is not None:
        with replace_when_complete(path) as part:
            figure.savefig(part, dpi=DPI)
    return figure
