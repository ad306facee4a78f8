"""Draw docs/images/offsets.png: a cut along the diagonals of cells that lie on a sphere, for each
offset.

python tools/draw_offsets.py
"""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

_HALF = 0.42  # of a diagonal, in radii of the sphere: enlarged
_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "#D9D9D9"
# Offset: title.
_PANELS = {
    "none": '"none"\npoints touch',
    "edge": '"edge" (eq 13)\nedges at rest touch',
    "cell": '"cell"\npoints stand off, no triangle inside',
}


def _turn(x: np.ndarray, angle: float) -> np.ndarray:
    c = math.cos(angle)
    s = math.sin(angle)
    return x @ np.array([[c, -s], [s, c]])  # clockwise


def _chain(offset: str) -> np.ndarray:
    """Four points of the cloth; the middle link lies on top of the sphere."""
    height = {"none": math.sqrt(1 - _HALF**2), "edge": math.sqrt(1 - _HALF**2 / 2)}.get(offset, 1.0)
    left, right = np.array([-_HALF, height]), np.array([_HALF, height])
    # The next link is the middle one seen in a mirror through the point between them.
    link = np.array([2 * _HALF, 0.0])
    angle = 2 * math.atan(_HALF / height)
    before, after = left - _turn(link, -angle), right + _turn(link, angle)
    return np.array([before, left, right, after])


def draw(path: Path) -> None:
    """Write the picture."""
    figure, axes = plt.subplots(1, 3, figsize=(7.5, 2.3), dpi=100, layout="constrained")
    for ax, (offset, title) in zip(axes, _PANELS.items(), strict=True):
        x = _chain(offset)
        ax.add_patch(plt.Circle((0, 0), 1, color=_GREY, lw=0))
        ax.plot(*x.T, "o-", color=_BLUE, lw=2, ms=6)
        if x[1, 1] < 1 - 1e-9:
            ax.plot([0, 0], [x[1, 1], 1], color=_ORANGE, lw=4, solid_capstyle="butt")
            ax.annotate("depth", (0, 1.03), ha="center", color=_ORANGE, fontsize=10)
        ax.set(xlim=(-1.1, 1.1), ylim=(0.45, 1.15), aspect="equal", title=title)
        ax.title.set_fontsize(11)
        ax.axis("off")
    figure.savefig(path, bbox_inches="tight")


if __name__ == "__main__":
    draw(Path(__file__).parents[1] / "docs/images/offsets.png")
