"""A scene as the numbers that the shader reads; each rounded once from the double that the core has."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import _core
from ..cloth import FAMILIES
from ..scene import Scene

FIRST_WEIGHT = 20
CONTACT_SIZE = 13

# (row, column) of a neighbour at the end of each of the shader's five springs.
_SPRINGS = (
    ("structural", 0, 1), ("structural", 1, 0), ("shear", 1, 1), ("bend", 0, 2), ("bend", 2, 0),
)  # fmt: skip


def scene_parameters(scene: Scene, speed_limit: float, dtype: npt.DTypeLike) -> np.ndarray:
    """What `parameters` holds of one member (layout.wgsl).

    Parameters
    ----------
    scene : Scene
    speed_limit : float
        Speed above which the state has run away [m/s]; may be infinite.
    dtype : numpy dtype
        That of the shader's arithmetic.
    """
    cloth = scene.cloth
    row_spacing, column_spacing = cloth.spacing
    # 1/mass is folded into the coefficients where it is uniform, as in the core.
    scale = 1 / float(cloth.mass_per_point[0, 0]) if cloth.uniform_mass else 1.0
    stiffness, damping = cloth.family_stiffness, cloth.family_damping
    limit = min(speed_limit, float(np.finfo(dtype).max))
    numbers = [*scene.gravity, cloth.point_damping * scale, limit]
    for family, rows, columns in _SPRINGS:
        along_rows, along_columns = rows * row_spacing, columns * column_spacing
        rest_length = math.sqrt(along_columns * along_columns + along_rows * along_rows)
        numbers += [stiffness.get(family, 0.0) * scale, rest_length, damping.get(family, 0.0) * scale]
    assert len(numbers) == FIRST_WEIGHT and set(stiffness) <= set(FAMILIES)
    weights = 1 / cloth.mass_per_point.ravel()
    weights[cloth.pinned.ravel()] = 0.0
    with np.errstate(over="ignore", under="ignore"):
        return np.concatenate([numbers, weights]).astype(dtype)


def step_constants(dt: float, dtype: npt.DTypeLike) -> npt.NDArray:
    """h/2, h, h^2/6 and h/6 of a time step."""
    return np.array([dt / 2, dt, dt * dt / 6, dt / 6]).astype(dtype)


def contacts(
    scenes: Sequence[Scene],
    plans: Sequence[_core.Plan],
    times: Sequence[float],
    single: bool,
    wide: npt.DTypeLike,
) -> np.ndarray:
    """What `contacts` holds: shape (times, scenes, spheres, 13).

    Parameters
    ----------
    scenes, plans : sequence of Scene, of Plan
        With equally many spheres each; the plans are the core's, which moves the spheres.
    times : sequence of float
        Times of collision passes [s].
    single : bool
        Whether a step's arithmetic is float32.
    wide : numpy dtype
        That of the responses' arithmetic.
    """
    real = np.float32 if single else np.float64
    margin = 1 + 8 * float(np.finfo(real).eps)
    table = np.empty((len(times), len(scenes), len(scenes[0].spheres), CONTACT_SIZE), wide)
    for k, (scene, plan) in enumerate(zip(scenes, plans, strict=True)):
        moving = plan.sphere_states(list(times))
        center = moving[..., :3]
        table[:, k, :, 0:3] = center
        table[:, k, :, 3:6] = center - table[:, k, :, 0:3]
        table[:, k, :, 6:9] = moving[..., 3:]
        for s, sphere in enumerate(scene.spheres):
            radius = sphere.contact_radius(scene.cloth)
            outer = real(radius * radius * margin)
            table[:, k, s, 9:] = radius, sphere.restitution, sphere.friction, outer
    return table
