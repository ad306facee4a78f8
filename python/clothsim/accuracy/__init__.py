"""Trusted solutions, and the errors of other methods, measured against them. See docs/accuracy.md."""

from .front import fastest
from .methods import RTOLS, Method, Outcome, extent, step_sizes
from .order import Convergence, convergence
from .solution import Reference, reference
from .work import work_precision
from .work_table import text_of_runs, write_runs

__all__ = [
    "RTOLS",
    "Convergence",
    "Method",
    "Outcome",
    "Reference",
    "convergence",
    "extent",
    "fastest",
    "reference",
    "step_sizes",
    "text_of_runs",
    "work_precision",
    "write_runs",
]
