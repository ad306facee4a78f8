"""Measured figures behind the claims about response "continuous".

Each figure is a function that returns a dict of numbers; `python benchmarks/contact` prints them,
the tests assert them, docs/contact-figures.md explains them. Sizes are arguments. Tests take small
sizes, and the command's ``--full`` takes the sizes of the claims.
"""

from .cost import cost, offsets
from .physics import cone, drop, resting, under_whole_cloth

__all__ = ["cone", "cost", "drop", "offsets", "resting", "under_whole_cloth"]
