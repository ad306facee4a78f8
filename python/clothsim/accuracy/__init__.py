"""Trusted solutions, and errors of other methods measured against them. See docs/accuracy.md."""

from .order import Convergence, convergence
from .solution import Reference, reference
from .work import Method, work_precision

__all__ = ["Convergence", "Method", "Reference", "convergence", "reference", "work_precision"]
