"""The checked input of a stepping call: scenes, state and time, and a warning where a sphere starts on the cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..errors import ContactWarning, warn_caller
from ..model.cells import point_radii2
from ..model.scene import Scene
from ..model.sphere import Sphere
from .arrays import FloatArray, check_driven_pins, checked_state, scenes_of, start_time
from .plan import in_cells, point_radius


@dataclass(frozen=True)
class Start:
    """The state from which a call steps."""

    scenes: list[Scene]  # one for each state
    batched: bool  # whether the state has a first axis of members
    x: FloatArray
    v: FloatArray
    t: float

    @classmethod
    def own(cls, scenes: list[Scene], batched: bool, t: float) -> Start:
        """The scenes' own states."""
        if not batched:
            return cls(scenes, False, scenes[0].initial_position, scenes[0].initial_velocity, t)
        x, v = np.array([one.initial_position for one in scenes]), np.array([one.initial_velocity for one in scenes])
        return cls(scenes, True, x, v, t)

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
# Part of what a cell adds to the radius. Half warns of sheets laid around a sphere by the cells at rest; twice hides
# another hundredth.
_STANDOFF_ROUNDING = 0.01


def _too_near(x: FloatArray, distance: FloatArray, radius: float, rounding: float) -> str:
    """Which mass points are nearer to a sphere than their cells let them be (docs/contact-law.md), in words."""
    radii2 = point_radii2(x.astype(np.float64)) / radius**2
    standoff = radius * (np.sqrt(1 + radii2) - 1)
    lacks = radius + standoff - distance
    # Cells larger than the sphere have a warning of their own.
    near = (lacks > rounding + _STANDOFF_ROUNDING * standoff) & (radii2 < 1)
    if not near.any():
        return ""
    row, column = (int(n) for n in np.unravel_index(np.argmax(np.where(near, lacks, 0)), near.shape))
    return (
        f"nothing is inside, but {int(near.sum())} mass points are nearer than their cells allow, the nearest, "
        f"{(row, column)}, by {lacks[row, column]:.3g} m; they are"
    )


def warn_of_start(scene: Scene, x: FloatArray, t: float, member: int | None, but: Sequence[Sphere] = ()) -> None:
    """Warn where a continuous sphere, `but` for some, is on the cloth at the start, with the deepest place."""
    cloth = scene.cloth
    for k, sphere in enumerate(scene.spheres):
        if sphere.response != "continuous" or sphere in but:
            continue
        radius, center = point_radius(sphere, cloth), sphere.center_at(t)
        with np.errstate(invalid="ignore"):  # the checks name a value that is not finite
            distance = np.linalg.norm(x.astype(np.float64) - center, axis=-1)
        depth = radius - distance
        rounding = _START_ROUNDING * (radius + np.abs(center).sum())
        inside = depth > rounding
        found = ""
        if inside.any():
            row, column = (int(n) for n in np.unravel_index(np.argmax(depth), depth.shape))
            found = (
                f"{int(inside.sum())} mass points are inside, the deepest, {(row, column)}, by "
                f"{depth[row, column]:.3g} m; they are"
            )
        elif sphere.offset == "cell":
            deepest = _core.penetration(cloth.rows, cloth.columns, np.ascontiguousarray(x, np.float64), center, radius)[1]
            if deepest > rounding:
                found = f"no mass point is inside, but a triangle by {deepest:.3g} m; it is"
            elif in_cells(sphere) and (distance < math.sqrt(2) * radius).any():
                found = _too_near(x, distance, radius, rounding)
        if found:
            warn_caller(
                f"spheres[{k}] starts on the cloth{'' if member is None else f' of member {member}'}: "
                f"{found} pushed out at {sphere.push_out_speed:g} m/s at most (push_out_speed)",
                ContactWarning,
            )
