"""Ready scenes: the scenes of Kim et al., a hanging sheet, an oscillator, and the hard cases."""

from typing import TYPE_CHECKING

from .base.extras import make_late_importers as _on_demand
from .model.ready import PAPER_DT, hanging, oscillator, paper_moving, paper_static, paper_swing

if TYPE_CHECKING:
    from .hard_cases import hard_cases

__all__ = [
    "PAPER_DT",
    "hanging",
    "hard_cases",
    "oscillator",
    "paper_moving",
    "paper_static",
    "paper_swing",
]

__getattr__, __dir__ = _on_demand(globals(), {"clothsim.hard_cases": ("hard_cases",)})
del TYPE_CHECKING
