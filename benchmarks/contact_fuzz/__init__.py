"""Fuzzers of contact: random points, triangles, shots, squeezes and sheets at rest, each against an independent check.

Run one with `python benchmarks/contact_fuzz NAME`; the tests take small sizes (docs/contact.md has the figures).
"""

from .crossings import crossings
from .rests import rests
from .shots import shots, squeezes
from .triangles import triangle_cases

__all__ = ["crossings", "rests", "shots", "squeezes", "triangle_cases"]
