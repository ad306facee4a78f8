"""A warning where a continuous sphere starts on the cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .. import _core
from ..errors import ContactWarning, warn_caller
from ..model.cells import point_radii2
from ..model.scene import Scene
from ..model.sphere import Sphere
from .arrays import FloatArray
from .plan import in_cells, point_radius

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
