"""Draw docs/images/layer.png: the layer of penalty contact over a sphere, and its push.

python tools/draw_layer.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

_BLUE, _ORANGE, _GREY, _PALE = "#0072B2", "#D55E00", "#D9D9D9", "#CFE3F1"
_SURFACE, _THICKNESS = 1.06, 0.24  # in radii of the sphere: enlarged
_EDGE = _SURFACE + _THICKNESS
_ANGLES = np.radians([134, 117, 100, 80, 63, 46])  # of the mass points, seen from the centre
_GAPS = np.array([0.38, 0.15, 0.12, 0.12, 0.15, 0.38])  # of the mass points, in radii
_RULER = np.radians(38)  # the angle at which lengths are drawn
_PUSH = 11.0  # length of an arrow over d^3 / h^2
# Closing speed times the dissipation c: label, colour.
_SPEEDS = {1.0: ("closing", _ORANGE), 0.0: ("at rest", "black"), -1.0: ("parting", _BLUE)}


def _draw_cut(ax: plt.Axes) -> None:
    """Draw a sheet that lies in the layer, with the lengths that have a name."""
    ax.add_patch(plt.Circle((0, 0), _EDGE, color=_PALE, lw=0))
    ax.add_patch(plt.Circle((0, 0), _SURFACE, color="white", lw=0))
    ax.add_patch(plt.Circle((0, 0), 1, color=_GREY, lw=0))
    directions = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
    places = (_SURFACE + _GAPS)[:, None] * directions
    ax.plot(*places.T, "o-", color="black", lw=1.5, ms=5)
    pushes = _PUSH * np.maximum(_THICKNESS - _GAPS, 0) ** 3 / _THICKNESS**2
    for place, direction, push in zip(places, directions, pushes, strict=True):
        if push > 0:
            arrow = {"arrowstyle": "-|>", "color": _ORANGE, "lw": 1.5}
            ax.annotate("", place + push * direction, place, arrowprops=arrow)
    ax.text(0, 0.87, "sphere", ha="center", va="center")
    direction = np.array([np.cos(_RULER), np.sin(_RULER)])
    for begin, end, name, height in (
        (1, _SURFACE, "offset", 0.6),
        (_SURFACE, _EDGE, "thickness h", 0.85),
    ):
        ends = np.outer((begin, end), direction)
        ax.plot(*ends.T, "o-", color=_ORANGE, lw=2, ms=3)
        line = {"arrowstyle": "-", "lw": 0.6}
        ax.annotate(name, ends.mean(axis=0), (1.15, height), arrowprops=line, va="center")
    ax.set(xlim=(-1.05, 1.6), ylim=(0.5, 1.6), aspect="equal")
    ax.axis("off")


def _draw_push(ax: plt.Axes) -> None:
    """Draw the push over the gap, for three speeds along the normal."""
    gap = np.linspace(-0.1, 1.2, 200)
    for speed, (label, color) in _SPEEDS.items():
        push = np.maximum(1 - gap, 0) ** 3 * (1 + speed / np.sqrt(1 + speed**2))
        ax.plot(gap, push, color=color, label=label)
    ax.axvspan(0, 1, color=_PALE, lw=0)
    ax.axvspan(-0.1, 0, color=_GREY, lw=0, alpha=0.5)
    ax.set(
        xlabel="gap over the surface / h", ylabel="push / (k h)", xlim=(-0.1, 1.2), ylim=(0, 1.8)
    )
    ax.legend(frameon=False)


def draw(path: Path) -> None:
    """Write the picture."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(8.4, 3.0), width_ratios=(1.35, 1), layout="constrained"
    )
    _draw_cut(left)
    _draw_push(right)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    draw(Path(__file__).parents[1] / "docs/images/layer.png")
