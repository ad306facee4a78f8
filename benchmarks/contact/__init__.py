"""Measured figures behind the claims about contact.

Each figure is a function that returns a dict of numbers; `python benchmarks/contact` prints them.
docs/contact.md and docs/accuracy.md have them. Sizes are arguments; the command's ``--full`` takes
those of the pages.
"""

from .compare import compare, draw
from .cost import cost
from .layer import layer

__all__ = ["compare", "cost", "draw", "layer"]
