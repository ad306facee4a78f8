"""A state between two steps: cubic Hermite interpolation, whose points go no deeper into a sphere than the states do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats
from ..engine.arrays import put_driven_pins
from ..engine.plan import in_cells, point_radius
from ..model.cells import point_radii2
from ..model.scene import Scene
from ..model.sphere import Sphere

State = tuple[Floats, Floats]  # positions and velocities
Step = tuple[float, float, State, State]  # its begin, a time of the scene [s], its length [s], and the states at both ends


def interpolated(t: float, scenes: Sequence[Scene], begin: float, h: float, before: State, after: State) -> State:
    """The state of a cloth or a batch at a time `t` within a step.

    Positions are the cubic Hermite polynomial of positions and velocities, of order 4 in the time step where no sphere
    responds. Velocities are its derivative, of order 3. Driven pins are where their motion has them.
    """
    (x0, v0), (x1, v1) = before, after
    s = (t - begin) / h
    x = x0 + s * (h * v0 + s * (3 * (x1 - x0) - h * (2 * v0 + v1) + s * (2 * (x0 - x1) + h * (v0 + v1))))
    v = v0 + s * (6 * (x1 - x0) / h - 2 * (2 * v0 + v1) + 3 * s * (2 * (x0 - x1) / h + v0 + v1))
    put_driven_pins(scenes, x, v, t)
    for k, scene in enumerate(scenes):
        member = k if x.ndim == 4 else ...
        for sphere in scene.spheres:
            ends = ((begin, x0[member]), (begin + h, x1[member]))
            _lift(x[member], ends, ~scene.cloth.pinned, sphere, point_radius(sphere, scene.cloth), t)
    return x, v


def _lift(x: Floats, ends: Any, free: npt.NDArray[np.bool_], sphere: Sphere, radius: float, t: float) -> None:
    """Lift free points to the lesser of their distances at both ends, where that is below the contact radius."""
    distances = [np.linalg.norm(places - sphere.center_at(time), axis=-1) for time, places in ends]
    center = sphere.center_at(t)
    away = x - center
    distance = np.linalg.norm(away, axis=-1)
    least = np.minimum(*distances)
    highest = np.full(distance.shape, radius)
    near = free & (distance < np.minimum(least, math.sqrt(2) * radius))
    if in_cells(sphere) and near.any():
        part = tuple(slice(max(k.min() - 1, 0), k.max() + 2) for k in np.nonzero(near))
        highest[part] *= np.sqrt(1 + np.minimum(point_radii2(x[part]) / radius**2, 1))
    allowed = np.minimum(least, highest)
    inside = free & (distance < allowed) & (distance > 0)
    x[inside] = center + away[inside] * (allowed[inside] / distance[inside])[:, None]
