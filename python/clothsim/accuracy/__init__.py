"""Trusted solutions, and the errors of other methods, measured against them. See docs/accuracy.md."""

from ..base.on_demand import on_demand as _on_demand
from .methods import RTOLS, Method, Outcome, extent, step_sizes
from .order import Convergence, convergence
from .solution import Reference, reference
from .work import work_precision

__all__ = [
    "RTOLS",
    "Convergence",
    "Method",
    "Outcome",
    "Reference",
    "convergence",
    "extent",
    "reference",
    "step_sizes",
    "work_precision",
]

__getattr__, __dir__ = _on_demand(globals(), {})
