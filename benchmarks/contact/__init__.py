"""Measured figures behind the claims about contact.

Each figure is a function that returns a dict of numbers; `python benchmarks/contact` prints them.
docs/contact.md has those of "penalty", docs/contact-figures.md those of "continuous", which the
tests assert. Sizes are arguments. Tests take small sizes, and the command's ``--full`` takes the
sizes of the claims.
"""

from .compare import compare, draw
from .cost import cost, offsets
from .layer import layer
from .physics import cone, drop, resting, under_whole_cloth

__all__ = [
    "compare",
    "cone",
    "cost",
    "draw",
    "drop",
    "layer",
    "offsets",
    "resting",
    "under_whole_cloth",
]
