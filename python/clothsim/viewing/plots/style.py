"""What all plots share: colours, markers, axes, legends and labels of lines."""

from __future__ import annotations

import math
from itertools import pairwise, product
from textwrap import fill
from typing import Any

import numpy as np

from ...base.extras import import_from_extra

# Okabe and Ito's palette: readers with any colour vision tell these colours apart. The least Lab
# distance of two of them is 16 in simulations of the three deficiencies, and grey would have 9 to
# pink and green.
BLACK = "#000000"
BLUE = "#0072B2"
GREEN = "#009E73"
RED = "#D55E00"
YELLOW = "#F0E442"
COLORS = (BLUE, RED, GREEN, BLACK, "#CC79A7", "#E69F00", "#56B4E9", YELLOW)
GREY = "0.5"
LIGHT_GREY = "0.85"

# Their number has no factor in common with that of the colours, so a second round of colours has
# other markers.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES = ("-", "--", ":", "-.", (0, (7, 2, 1, 2, 1, 2)))

DPI = 120
"""Pixels per inch of a picture file."""

HOLLOW = {"mfc": "white", "ls": "none", "zorder": 3}
"""Look of points whose value is not certain, over that of their line."""

_MOST_ROWS = 16
"""Rows of a legend, which is as high as axes of the default size."""

_LETTERS = 13.0
"""Small letters per inch."""

FEW = 20
"""Below this number of points a line has a marker at each."""


def line_style(k: int) -> dict[str, Any]:
    """Return colour, marker and dash of the line number `k`.

    Lines of one colour differ in marker and dash.
    """
    return {
        "color": COLORS[k % len(COLORS)],
        "marker": MARKERS[k % len(MARKERS)],
        "ls": DASHES[k % len(DASHES)],
        "ms": 4,
    }


def axes_to_show(
    ax: Any = None,
    columns: int = 1,
    rows: int = 1,
    width: float = 6.4,
    height: float = 4.6,
    **options: Any,
) -> list[Any]:
    """Return the `rows` x `columns` axes of a caller, or those of a new figure of pyplot."""
    count = rows * columns
    if ax is None:
        pyplot = import_from_extra("matplotlib.pyplot", "plot", "plot")
        size = (width, height)
        figure, grid = pyplot.subplots(
            rows, columns, figsize=size, layout="constrained", squeeze=False, **options
        )
        for axes in grid.flat:
            tidy_axes(axes)
        return list(grid.flat)
    panels = list(np.ravel(ax))
    if len(panels) != count or not all(hasattr(axes, "plot") for axes in panels):
        raise ValueError(f"ax must be None or axes of matplotlib, {count} of them, got {ax!r}")
    return panels


def tidy_axes(axes: Any) -> None:
    """Draw a thin grid, and no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)


def put_legend_beside(axes: Any, title: str | None = None) -> None:
    """Put the legend to the right of the axes: inside, some line would always be under it."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(
        title=title,
        fontsize="small",
        title_fontsize="small",
        ncols=-(-count // _MOST_ROWS),
        frameon=False,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        borderaxespad=0.0,
    )


def wrap_text(text: str, axes: Any) -> str:
    """Return a text in lines of small letters that are as wide as the axes at most."""
    inches = axes.get_window_extent().width / axes.figure.dpi
    return fill(text, max(20, int(_LETTERS * inches)))


def separate_ticks(axes: Any) -> None:
    """Turn the labels of the x axis where they overlap."""
    axes.figure.draw_without_rendering()  # lays out the axes
    labels = axes.xaxis.get_ticklabels(which="both")
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    boxes.sort(key=lambda box: box.x0)
    if any(b.x0 < a.x1 + 2 for a, b in pairwise(boxes)):
        for label in labels:
            label.set(rotation=30, ha="right", rotation_mode="anchor")


# Offsets from a point of a line [points] to its label; the signs say on which side the text is. The
# first place that is free is taken.
PLACES = [
    (7, 0),
    (7, -9),
    (7, 9),
    (0, -12),
    (0, 12),
    (-7, -9),
    (-7, 9),
    (-7, 0),
    (12, -20),
    (12, 20),
    (-12, -20),
    (-12, 20),
]


# Costs of a place of a label in samples of lines that it covers: another label is worse than lines,
# and the edge of the axes worse than all.
_OVERLAP = 1e3
_OUTSIDE = 1e6


_INK = 0.75
"""Factor from the colour of a line to that of its label: yellow letters are hard to read."""


def label_lines(axes: Any) -> None:
    """Label each line at a point, if possible an end, where least lines and labels overlap."""
    to_rgb = import_from_extra("matplotlib.colors", "plot", "plot").to_rgb
    axes.figure.draw_without_rendering()  # lays out the axes
    paths = [
        line.get_transform().transform(line.get_xydata())
        for line in axes.lines
        if len(line.get_xydata())
    ]
    ink = np.concatenate(
        [np.linspace(a, b, 60) for path in paths for a, b in zip(path, [*path[1:], path[-1]])]
    )
    boxes = np.empty((0, 2, 2))  # lower left and upper right corners of labels [pixels]
    for line in axes.lines:
        points = line.get_xydata()[np.isfinite(line.get_xydata()).all(axis=1)]
        if line.get_label().startswith("_") or not len(points):
            continue
        look = {
            "textcoords": "offset points",
            "fontsize": "small",
            "color": _INK * np.array(to_rgb(line.get_color())),
            "va": "center",
        }
        text = axes.annotate(line.get_label(), points[-1], PLACES[0], annotation_clip=False, **look)
        size = text.get_window_extent().size
        pixels = axes.transData.transform(points)
        from_ends = sorted(range(len(points)), key=lambda k: min(k + 0.5, len(points) - 1 - k))
        least = math.inf
        for k, (dx, dy) in product(from_ends, PLACES):
            offset = np.multiply((dx, dy), axes.figure.dpi / 72)
            low = pixels[k] + offset - size * (0.5 - 0.5 * np.sign(dx), 0.5)
            crossings = ((ink > low - 2) & (ink < low + size + 2)).all(axis=1).sum()
            overlaps = ((boxes[:, 0] < low + size) & (boxes[:, 1] > low)).all(axis=1).sum()
            outside = 2 - axes.bbox.count_contains([low, low + size])
            cost = crossings + _OVERLAP * overlaps + _OUTSIDE * outside
            if cost < least:
                least = cost
                text.xy = points[k]
                text.xyann = (dx, dy)
                text.set_ha(("right", "center", "left")[np.sign(dx) + 1])
                box = [low, low + size]
            if cost == 0:
                break
        boxes = np.concatenate([boxes, [box]])
