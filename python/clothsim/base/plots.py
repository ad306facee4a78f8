"""One style for all plots: colours, grid and frame of figures that need no display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .extras import needed
from .files import replacing

# Okabe and Ito's palette: readers with any colour vision tell these colours apart.
BLACK, BLUE, GREEN, RED, YELLOW = "#000000", "#0072B2", "#009E73", "#D55E00", "#F0E442"
GREY, LIGHT_GREY = "0.5", "0.85"

DPI = 120
"""Pixels per inch of a picture file."""


def figure(
    width: float, height: float, rows: int = 1, columns: int = 1, what: str = "a picture", base: Any = None, **options: Any
) -> tuple[Any, Any]:
    """A figure of `width` x `height` inches and its axes, an array of shape (rows, columns).

    Parameters
    ----------
    width, height : float
    rows, columns : int, default 1
    what : str
        Subject of the error where matplotlib is missing.
    base : class, optional
        The class of the figure. Default: matplotlib's.
    options
        As for ``Figure.subplots``.

    Raises
    ------
    ImportError
        Without matplotlib, naming the extra that brings it.
    """
    kind = base or needed("matplotlib.figure", what, "plot").Figure
    made = kind(figsize=(width, height), layout="constrained")
    needed("matplotlib.backends.backend_agg", what, "plot").FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False, **options)
    for one in axes.ravel():
        tidy(one)
    return made, axes


def save(drawn: Any, path: Path) -> None:
    """Write a figure to a picture file, whole or not at all."""
    with replacing(path) as part:
        drawn.savefig(part, dpi=DPI)


def tidy(axes: Any) -> None:
    """A thin grid, and no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
