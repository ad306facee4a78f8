"""What all plots share: colours, markers, axes, legends and labels of lines."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from ...base.extras import needed

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

FEW = 20
"""Below this number of points a line has a marker at each."""


def style(k: int) -> dict[str, Any]:
    """Return colour, marker and dash of the line number `k`.

    Lines of one colour differ in marker and dash.
    """
    return {
        "color": COLORS[k % len(COLORS)],
        "marker": MARKERS[k % len(MARKERS)],
        "ls": DASHES[k % len(DASHES)],
        "ms": 4,
    }


def shown_axes(
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
        pyplot = needed("matplotlib.pyplot", "plot", "plot")
        size = (width, height)
        figure, grid = pyplot.subplots(
            rows, columns, figsize=size, layout="constrained", squeeze=False, **options
        )
        for axes in grid.flat:
            tidy(axes)
        return list(grid.flat)
    panels = list(np.ravel(ax))
    if len(panels) != count or not all(hasattr(axes, "plot") for axes in panels):
        raise ValueError(f"ax must be None or axes of matplotlib, {count} of them, got {ax!r}")
    return panels


def tidy(axes: Any) -> None:
    """Draw a thin grid, and no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)


def legend_beside(axes: Any, title: str | None = None) -> None:
    """Put the legend to the right of the axes: inside, some line would always be under it."""
    axes.legend(
        title=title,
        fontsize="small",
        frameon=False,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        borderaxespad=0.0,
    )


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


def label_lines(axes: Any) -> None:
    """Label each line at a point, if possible an end, without overlap with lines or labels."""
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
            "color": line.get_color(),
            "va": "center",
        }
        text = axes.annotate(line.get_label(), points[-1], PLACES[0], annotation_clip=False, **look)
        size = text.get_window_extent().size
        pixels = axes.transData.transform(points)
        from_ends = sorted(range(len(points)), key=lambda k: min(k + 0.5, len(points) - 1 - k))
        for k, (dx, dy) in product(from_ends, PLACES):
            offset = np.multiply((dx, dy), axes.figure.dpi / 72)
            low = pixels[k] + offset - size * (0.5 - 0.5 * np.sign(dx), 0.5)
            crossed = ((ink > low - 2) & (ink < low + size + 2)).all(axis=1).any()
            crossed |= ((boxes[:, 0] < low + size) & (boxes[:, 1] > low)).all(axis=1).any()
            if not crossed and axes.bbox.count_contains([low, low + size]) == 2:
                break
        text.xy = points[k]
        text.xyann = (dx, dy)
        text.set_ha(("right", "center", "left")[np.sign(dx) + 1])
        boxes = np.concatenate([boxes, [[low, low + size]]])
