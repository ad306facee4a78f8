"""Measured figures behind the claims about response "continuous" and offset "face".

Each figure is a function that returns a dict of numbers; `python benchmarks/contact` prints them, the tests
assert them, docs/contact-figures.md explains them. Sizes are arguments. Tests take small sizes, and the command's ``--full``
takes the sizes of the claims.
"""

from .cost import cost, drape, offsets
from .law import draped, face_drop, impact, lying, stick, symmetry
from .physics import cone, drop, resting, under_whole_cloth

__all__ = [
    "cone",
    "cost",
    "drape",
    "draped",
    "drop",
    "face_drop",
    "impact",
    "lying",
    "offsets",
    "resting",
    "stick",
    "symmetry",
    "under_whole_cloth",
]
