"""Fuzzers of contact: random points and random shots at sheets, each against an independent check.

Run one with `python benchmarks/contact_fuzz NAME`; the tests take small sizes
(docs/contact-figures.md has the figures).
"""

from .cells import cells
from .crossings import crossings

__all__ = ["cells", "crossings"]
