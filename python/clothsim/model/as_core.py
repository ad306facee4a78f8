"""A cloth, motions and driven pins as the core takes them."""

from __future__ import annotations

from typing import Any

from .. import _core
from .cloth import Cloth
from .scene import Scene


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
    """Driven pins as the core takes them: their motions, and (point, start, motion) in the order of points."""
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
