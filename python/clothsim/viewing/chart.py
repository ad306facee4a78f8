"""Curves of a run over its stored frames, and one figure of them by matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import check
from ..base.extras import needed
from ..base.plots import BLACK, BLUE, DPI, GREEN, RED, figure, name_lines, save
from ..base.progress import ProgressBar
from ..model.scene import Scene
from .picture import file_path

Curves = dict[str, npt.NDArray[np.float64]]

PARTS = 4  # kinds of measures, each of all frames

TOUCH = 1 / 32
"""A mass point touches a sphere if it is closer to it than the contact radius and this part of the
spacing: 1 mm for 32 points on a metre. Half of it misses points that bounce while they rest, twice
of it counts points that only pass."""


def touching(scene: Scene, x: npt.NDArray[np.float64], t: float) -> int:
    """Number of mass points that touch a sphere at the time `t`."""
    near = TOUCH * max(scene.cloth.spacing)
    touched = np.zeros(scene.cloth.shape, bool)
    for sphere in scene.spheres:
        distance = np.linalg.norm(x - sphere.center_at(t), axis=-1)
        touched |= distance <= sphere.contact_radius(scene.cloth) + near
    return int(touched.sum())


def curves(run: Any, advance: Callable[[int], object] = lambda _: None) -> Curves:
    """Each curve, shape (frames,). `advance` advances by `PARTS` for every frame.

    "kinetic", "elastic", "gravity", "force" and "total" [J]; "stretch" of the most stretched spring, l/L - 1;
    "points" and "triangles", the deepest of each below the true radius of any sphere [m]; "contacts",
    the number of mass points that touch a sphere. Without a sphere the last three are missing.
    """
    found: Curves = dict(run.energy())
    advance(len(run.t))
    found["stretch"] = run.stretch()["largest"]
    advance(len(run.t))
    if run.scene.spheres:
        found |= run.penetration()
    advance(len(run.t))
    if run.scene.spheres:
        pairs = zip(run.x, run.t, strict=True)
        found["contacts"] = np.array([touching(run.scene, x, float(t)) for x, t in pairs], float)
    advance(len(run.t))
    return found


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
DECADES = 1e-4  # part of the largest value below which a logarithmic axis is linear
LABELS = {"points": "deepest point", "triangles": "deepest triangle"}


def plot(run: Any, path: str | Path | None = None, progress: bool = False, log: bool = False) -> Any:
    """`Run.plot`: the figure, for a notebook. It is also written to `path` if a path is given.

    With `progress`, a bar counts frames.
    """
    what, log = "run.plot", check.boolean("log", log)
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
        _scale(axis, scale * np.concatenate([found[name] for name in names]), log)
        if len(names) > 1:
            name_lines(axis)
    axes[-1, 0].set_xlabel("time [s]")
    drawn.align_ylabels()
    if path is not None:
        save(drawn, path)
    return drawn


def _scale(axis: Any, values: Any, log: bool) -> None:
    """Limits from 0, or a logarithmic axis, which is linear around 0 where values are not all positive."""
    sizes = np.abs(values[np.isfinite(values)])
    if log and sizes.any():
        # Linear below four decades: smaller values are of the first frames, or rounding.
        # A power of ten: the ticks at 0 and at the end of the linear part have room.
        least = 10.0 ** np.ceil(np.log10(DECADES * sizes.max()))
        if np.nanmin(values) >= least:
            axis.set_yscale("log")
        else:
            axis.set_yscale("symlog", linthresh=least)
            axis.yaxis.get_major_locator().set_params(numticks=5)
            axis.set_ylim(bottom=None if np.nanmin(values) < 0 else 0)
    elif not np.any(values < 0):
        axis.set_ylim(bottom=0)
