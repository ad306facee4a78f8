"""Fuzzers of contact: random points, triangles, shots, squeezes and sheets at rest, each against an independent check.

Run one with `python benchmarks/contact_fuzz NAME`; the tests take small sizes (docs/contact-figures.md has the figures).
"""

from .cells import cells
from .crossings import crossings
from .rests import rests
from .shots import shots, squeezes
from .triangles import triangle_cases

__all__ = ["cells", "crossings", "rests", "shots", "squeezes", "triangle_cases"]
