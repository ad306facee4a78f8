"""The checked input of a stepping call: scenes, state and time, and a warning where a sphere starts on the cloth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..errors import ContactWarning, warn_caller
from ..model.scene import Scene
from ..model.sphere import Sphere
from .arrays import FloatArray, check_driven_pins, checked_state, scenes_of, start_time
from .plan import point_radius


@dataclass(frozen=True)
class Start:
    """The state from which a call steps."""

    scenes: list[Scene]  # one for each state
    batched: bool  # whether the state has a first axis of members
    x: FloatArray
    v: FloatArray
    t: float

    @classmethod
    def checked(
        cls, scene: Scene | Sequence[Scene], x: Any, v: Any, t: float | None, precision: str, inspect: bool
    ) -> Start:
        """The arguments of a call. The state or time that a call leaves out is the scenes' own. `inspect`: refuse
        positions in which driven pins are elsewhere.
        """
        scenes, given = scenes_of(scene), x is not None
        batched = not isinstance(scene, Scene)
        time = 0.0 if t is None and x is None else start_time(t, scenes)
        if x is None:
            x = np.stack([s.initial_position for s in scenes]) if batched else scenes[0].initial_position
        if v is None:
            v = np.stack([s.initial_velocity for s in scenes]) if batched else scenes[0].initial_velocity
            v = np.broadcast_to(v, np.shape(x))
        x, v = checked_state(x, v, scenes, batched, precision)
        if inspect and given:
            check_driven_pins(scenes * len(x) if x.ndim == 4 and not batched else scenes, x, time)
        members = x.ndim == 4
        return cls(scenes if batched or not members else scenes * len(x), members, x, v, time)


# Rounding of float32 positions, as part of the radius and the distance of the centre. With half of it float32 states on
# the surface give false warnings; twice as much hides 2e-6 of the radius.
_START_ROUNDING = 1e-6


def warn_of_start(scene: Scene, x: FloatArray, t: float, member: int | None, but: Sequence[Sphere] = ()) -> None:
    """Warn where a continuous sphere, `but` for some, is on the cloth at the start, with the deepest place."""
    cloth = scene.cloth
    for k, sphere in enumerate(scene.spheres):
        if sphere.response != "continuous" or sphere in but:
            continue
        radius, center = point_radius(sphere, cloth), sphere.center_at(t)
        with np.errstate(invalid="ignore"):  # the checks name a value that is not finite
            depth = radius - np.linalg.norm(x.astype(np.float64) - center, axis=-1)
        rounding = _START_ROUNDING * (radius + np.abs(center).sum())
        inside = depth > rounding
        found = ""
        if inside.any():
            row, column = (int(n) for n in np.unravel_index(np.argmax(depth), depth.shape))
            found = (
                f"{int(inside.sum())} mass points are inside, the deepest, {(row, column)}, by "
                f"{depth[row, column]:.3g} m; they are"
            )
        elif sphere.offset in ("cell", "face"):
            deepest = _core.penetration(cloth.rows, cloth.columns, np.ascontiguousarray(x, np.float64), center, radius)[1]
            if deepest > rounding:
                found = f"no mass point is inside, but a triangle by {deepest:.3g} m; it is"
        if found:
            warn_caller(
                f"spheres[{k}] starts on the cloth{'' if member is None else f' of member {member}'}: "
                f"{found} pushed out at {sphere.push_out_speed:g} m/s at most (push_out_speed)",
                ContactWarning,
            )
