"""One style for all plots: colours, grid and frame of figures that need no display."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .extras import needed
from .files import replacing

# Okabe and Ito's palette: readers with any colour vision tell these colours apart. The least Lab distance of two of them
# is 16 in simulations of the three deficiencies, and grey would have 9 to pink and green.
BLACK, BLUE, GREEN, RED, YELLOW = "#000000", "#0072B2", "#009E73", "#D55E00", "#F0E442"
COLORS = (BLUE, RED, GREEN, BLACK, "#CC79A7", "#E69F00", "#56B4E9", YELLOW)
GREY, LIGHT_GREY = "0.5", "0.85"

# Of lengths without a common factor to the colours: a further round of colours has other markers.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES = ("-", "--", ":", "-.", (0, (7, 2, 1, 2, 1, 2)))

DPI = 120
"""Pixels per inch of a picture file."""


def figure(
    width: float, height: float, rows: int = 1, columns: int = 1, what: str = "a picture", base: Any = None, **options: Any
) -> tuple[Any, Any]:
    """A figure of `width` x `height` inches and its axes, an array of shape (rows, columns).

    `what` is the subject of the ImportError where matplotlib is missing, `base` the class of the figure in place of
    matplotlib's. `options` are those of ``Figure.subplots``.
    """
    kind = base or needed("matplotlib.figure", what, "plot").Figure
    made = kind(figsize=(width, height), layout="constrained")
    needed("matplotlib.backends.backend_agg", what, "plot").FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False, **options)
    for one in axes.ravel():
        tidy(one)
    return made, axes


def style(k: int) -> dict[str, Any]:
    """Colour, marker and dash of the line number `k` of a figure; lines of one colour differ in marker and dash."""
    return {"color": COLORS[k % len(COLORS)], "marker": MARKERS[k % len(MARKERS)], "ls": DASHES[k % len(DASHES)], "ms": 4}


def shown_axes(ax: Any = None, columns: int = 1, width: float = 6.4, height: float = 4.6, **options: Any) -> list[Any]:
    """The axes that a caller gave, `columns` of them, or the axes of a new figure that pyplot shows."""
    given = [] if ax is None else list(np.ravel(ax))
    if not given:
        pyplot = needed("matplotlib.pyplot", "plot", "plot")
        given = list(np.ravel(pyplot.subplots(1, columns, figsize=(width, height), layout="constrained", **options)[1]))
        for one in given:
            tidy(one)
    if len(given) != columns or not all(hasattr(one, "plot") for one in given):
        raise ValueError(f"ax must be None or axes of matplotlib, {columns} of them, got {ax!r}")
    return given


# From an end of a line [points] to its label, and which side of the text is there; the first that is free is taken.
PLACES = [(7, 0), (7, -9), (7, 9), (0, -12), (0, 12), (-7, -9), (-7, 9), (-7, 0), (12, -20), (12, 20), (-12, -20), (-12, 20)]


def label_lines(axes: Any) -> None:
    """Label each line at one of its points, if possible an end, without overlap with other lines or labels."""
    axes.figure.draw_without_rendering()  # lays out the axes
    paths = [line.get_transform().transform(line.get_xydata()) for line in axes.lines if len(line.get_xydata())]
    ink = np.concatenate([np.linspace(a, b, 60) for path in paths for a, b in zip(path, [*path[1:], path[-1]])])
    taken = np.empty((0, 2, 2))  # lower left and upper right corners of labels [pixels]
    for line in axes.lines:
        points = line.get_xydata()[np.isfinite(line.get_xydata()).all(axis=1)]
        if line.get_label().startswith("_") or not len(points):
            continue
        look = {"textcoords": "offset points", "fontsize": "small", "color": line.get_color(), "va": "center"}
        text = axes.annotate(line.get_label(), points[-1], PLACES[0], annotation_clip=False, **look)
        size, pixels = text.get_window_extent().size, axes.transData.transform(points)
        from_ends = sorted(range(len(points)), key=lambda k: min(k + 0.5, len(points) - 1 - k))
        for k, (dx, dy) in product(from_ends, PLACES):
            low = pixels[k] + np.multiply((dx, dy), axes.figure.dpi / 72) - size * (0.5 - 0.5 * np.sign(dx), 0.5)
            crossed = ((ink > low - 2) & (ink < low + size + 2)).all(axis=1).any()
            crossed |= ((taken[:, 0] < low + size) & (taken[:, 1] > low)).all(axis=1).any()
            if not crossed and axes.bbox.count_contains([low, low + size]) == 2:
                break
        text.xy, text.xyann = points[k], (dx, dy)
        text.set_ha(("right", "center", "left")[np.sign(dx) + 1])
        taken = np.concatenate([taken, [[low, low + size]]])


def save(drawn: Any, path: Path) -> None:
    """Write a figure to a picture file, whole or not at all."""
    with replacing(path) as part:
        drawn.savefig(part, dpi=DPI)


def tidy(axes: Any) -> None:
    """A thin grid, and no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
