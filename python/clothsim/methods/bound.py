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


def usable_dt(cloth: _core.Cloth, integrator: str) -> float:
    """`guaranteed_dt`, or a ValueError for a method that has no stable time step for this cloth."""
    limit = guaranteed_dt(cloth, integrator)
    if limit == 0:
        raise ValueError(
            f"dt must be given with integrator {integrator!r}, which has no stable time step for this scene: it amplifies "
            "undamped motion at every time step; or take 'semi_implicit_euler' or 'rk4'"
        )
    return limit


def stable_dt(scene: Scene, integrator: str = "rk4") -> float:
    """The guaranteed time step of a scene [s]."""
    return guaranteed_dt(core_cloth(scene.cloth), integrator)


# A sweep asks for thousands of cloths of few kinds, and every call of `step` asks again.
_limit = lru_cache(maxsize=4096)(box_limit)
