"""Plots by matplotlib, one file for each kind of result.

Each function draws on the matplotlib axes `ax`, or on those of a new figure, and returns the axes.
Only `Run.plot` returns a figure.
"""

from __future__ import annotations

from typing import Any

from .sensitivity import draw_sensitivity
from .stability_map import draw_map
from .sweep import draw_sweep
from .work_precision import draw_work_precision


def plot(dataset: Any, kind: str | None = None, **options: Any) -> Any:
    """Draw a Dataset of this package: `Dataset.clothsim.plot`."""
    if "status" in dataset:
        return draw_sweep(dataset, kind, **options)
    if kind is not None:
        raise ValueError(f"kind must be None for a Dataset that is of no sweep, got {kind!r}")
    if "solver" in dataset.dims:
        return draw_work_precision(dataset, **options)
    if "predicted" in dataset:
        return draw_map(dataset, **options)
    if "dx" in dataset:
        return draw_sensitivity(dataset, **options)
    raise ValueError(
        "dataset must be of sweep, stability_map, work_precision or sensitivity, got one without "
        "their variables"
    )
