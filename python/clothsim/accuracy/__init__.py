"""Trusted solutions, and errors of other methods measured against them. See docs/accuracy.md."""

from .solution import Reference, reference
from .work import Convergence, Method, convergence, work_precision

__all__ = ["Convergence", "Method", "Reference", "convergence", "reference", "work_precision"]
