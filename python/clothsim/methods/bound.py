"""The time step that is stable for a cloth in all but extreme states; see `max_stable_dt`."""

from __future__ import annotations

import math
from functools import lru_cache

from .. import _core
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .region import box_limit


def guaranteed_dt(cloth: _core.Cloth, integrator: str) -> float:
    """The guarantee that `clothsim.max_stable_dt` gives without a state [s]."""
    stiffness, damping = cloth.mode_bounds
    return _limit(integrator, math.sqrt(stiffness), damping)


def stable_dt(scene: Scene, integrator: str = "rk4") -> float:
    """The guaranteed time step of a scene [s]."""
    return guaranteed_dt(core_cloth(scene), integrator)


# A sweep asks for thousands of cloths of few kinds, and every call of `step` asks again.
_limit = lru_cache(maxsize=4096)(box_limit)
