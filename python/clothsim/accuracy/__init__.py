"""Trusted solutions, and errors of other methods measured against them. See docs/accuracy.md."""

from ..base.extras import on_demand as _on_demand
from .solution import Reference, reference
from .work import Convergence, Method, convergence, work_precision

__all__ = ["Convergence", "Method", "Reference", "convergence", "reference", "work_precision"]

__getattr__, __dir__ = _on_demand(globals(), {})
