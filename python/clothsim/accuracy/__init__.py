"""Trusted solutions, and the errors of other methods, measured against them. See docs/accuracy.md."""

from .cache import cache_directory
from .order import Convergence, convergence
from .solution import Reference, reference
from .work import work_precision

__all__ = ["Convergence", "Reference", "cache_directory", "convergence", "reference", "work_precision"]
