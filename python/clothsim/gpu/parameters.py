"""A scene as numbers for the shader. Each number is rounded once from the core's double."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..model.cloth import FAMILIES
from ..model.scene import Scene

# Family, row and column of a neighbour at the end of each kind of spring.
_SPRINGS = _core.spring_kinds

FIRST_SPRING = 5
FIRST_WEIGHT = FIRST_SPRING + 3 * len(_SPRINGS)
CONTACT_SIZE = 26

_SHARED = {
    "group_size": _core.group_size,
    "first_spring": FIRST_SPRING,
    "first_weight": FIRST_WEIGHT,
    "contact_size": CONTACT_SIZE,
}
"""Numbers that the shader shares with the core or with the host."""


def shared_numbers() -> str:
    """WGSL of the numbers that are written down elsewhere."""
    return "\n".join(f"const {name} = {value}u;" for name, value in _SHARED.items())


def rest_lengths(scene: Scene) -> list[float]:
    """Rest lengths of the kinds of springs [m]."""
    row_spacing, column_spacing = scene.cloth.spacing
    along = [(rows * row_spacing, columns * column_spacing) for _, rows, columns in _SPRINGS]
    return [math.sqrt(c * c + r * r) for r, c in along]


def scene_parameters(scene: Scene, speed_limit: float, dtype: npt.DTypeLike) -> np.ndarray:
    """Entry of `parameters` for one member (layout.wgsl), in the type of the shader's arithmetic.

    `speed_limit` is the speed above which the state has run away [m/s]; it may be infinite.
    """
    cloth = scene.cloth
    # 1/mass is folded into the coefficients where it is uniform, as in the core.
    scale = 1 / float(cloth.mass_per_point[0, 0]) if cloth.uniform_mass else 1.0
    stiffness, damping = cloth.family_stiffness, cloth.family_damping
    limit = min(speed_limit, float(np.finfo(dtype).max))
    numbers = [*scene.gravity, cloth.drag * scale, limit]
    for (family, *_), rest_length in zip(_SPRINGS, rest_lengths(scene), strict=True):
        spring = stiffness.get(family, 0.0), damping.get(family, 0.0)
        numbers += [spring[0] * scale, rest_length, spring[1] * scale]
    assert len(numbers) == FIRST_WEIGHT and set(stiffness) <= set(FAMILIES)
    weights = 1 / cloth.mass_per_point.ravel()
    weights[cloth.pinned.ravel()] = 0.0
    with np.errstate(over="ignore", under="ignore"):
        return np.concatenate([numbers, weights]).astype(dtype)


def step_constants(dt: float, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """h/2, h, h^2/6 and h/6 of a time step."""
    return np.array([dt / 2, dt, dt * dt / 6, dt / 6]).astype(dtype)


def contacts(
    scenes: Sequence[Scene],
    plans: Sequence[_core.Plan],
    origins: np.ndarray,
    times: Sequence[float],
    dt: float,
    single: bool,
    wide: npt.DTypeLike,
) -> np.ndarray:
    """`contacts` (contact.wgsl): shape (times, scenes, spheres, CONTACT_SIZE).

    All scenes have the same number of spheres, which the plans of the core move. `origins` are those of the positions [m],
    shape (scenes, 3). `times` are before the first step and after each step [s]; one time where no sphere moves. `single`:
    a step's arithmetic is float32. `wide` is the type of the arithmetic of the responses.
    """
    shape = (len(times), len(scenes), len(scenes[0].spheres), CONTACT_SIZE)
    table = np.zeros(shape, wide)
    for k, plan in enumerate(plans):
        values = plan.contact_table(list(times), origins[k], dt, single)
        row = table[:, k]
        row[..., 0:3] = values[..., :3]
        row[..., 3:6] = values[..., :3] - row[..., 0:3]
        row[..., 6:] = values[..., 3:]
    return table
