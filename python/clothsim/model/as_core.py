"""A cloth, spheres, motions and driven pins as the core takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import _core
from .cloth import Cloth
from .scene import Scene
from .sphere import Plane, Sphere


def core_cloth(cloth: Cloth) -> _core.Cloth:
    """The cloth as the core takes it, made once."""
    made: _core.Cloth | None = cloth.__dict__.get("_core")
    if made is None:
        made = cloth.__dict__["_core"] = _made(cloth)
    return made


def _made(cloth: Cloth) -> _core.Cloth:
    (rows, columns), (row_spacing, column_spacing) = cloth.shape, cloth.spacing
    return _core.Cloth(
        rows=rows,
        columns=columns,
        row_spacing=row_spacing,
        column_spacing=column_spacing,
        stiffness=cloth.family_stiffness,
        spring_damping=cloth.family_damping,
        drag=cloth.drag,
        mass=cloth.mass_per_point,
        uniform_mass=cloth.uniform_mass,
        pinned=cloth.pinned,
    )


def core_pins(scene: Scene) -> dict[str, Any]:
    """Driven pins in the form of the core: their motions, and (point, start, index of the motion) in the order of points."""
    groups = scene.driven_pins
    if not groups:
        return {"pin_motions": [], "driven_pins": []}
    columns = scene.cloth.columns
    pins = [
        (int(r) * columns + int(c), start, k)
        for k, group in enumerate(groups)
        for r, c, start in zip(group.rows, group.columns, group.starts)
    ]
    return {"pin_motions": [group.motion.core for group in groups], "driven_pins": sorted(pins, key=lambda pin: pin[0])}


def in_cells(sphere: Sphere | Plane) -> bool:
    """Whether the contact radius of each mass point follows from its deformed cells."""
    return sphere.offset == "cell" and sphere.response == "continuous"


def core_spheres(scene: Scene) -> list[_core.Sphere]:
    """The spheres and planes of a scene in the form of the core, cached."""
    made: list[_core.Sphere] | None = scene.__dict__.get("_core_spheres")
    if made is None:
        made = scene.__dict__["_core_spheres"] = [core_sphere(sphere, scene) for sphere in scene.spheres]
    return made


def core_sphere(sphere: Sphere | Plane, scene: Scene | None = None) -> _core.Sphere:
    """The sphere or plane in the form of the core, without offset if no scene is given.

    The core measures points from the top of a sphere, against gravity, or from the `point` of a plane. Points are assumed to
    get at most four sizes of the cloth farther from there than they start.
    """
    up = np.array((0.0, 1.0, 0.0)) if scene is None or not any(scene.gravity) else -np.array(scene.gravity)
    if isinstance(sphere, Plane):
        up = sphere.unit_normal
    normal = up / np.linalg.norm(up)
    offset, spread = 0.0, 1.0
    if scene is not None:
        offset = 0.0 if in_cells(sphere) else sphere.offset_length(scene.cloth)
        place = sphere.center_at(0.0) + (0 if isinstance(sphere, Plane) else sphere.radius * normal)
        spread = 4 * float(np.hypot(*scene.cloth.size)) + float(np.abs(scene.initial_position - place).max())
    return _core.Sphere(
        center=sphere.center,
        radius=sphere.radius,
        offset=offset,
        response=sphere.response,
        as_printed=sphere.as_printed,
        restitution=sphere.restitution,
        friction=sphere.friction,
        motion=sphere.motion.core if sphere.motion else _core.Motion(),
        cells=in_cells(sphere),
        push_out_speed=sphere.push_out_speed,
        normal=normal,
        spread=spread,
    )
