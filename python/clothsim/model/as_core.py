"""A cloth as the core takes it."""

from __future__ import annotations

from .. import _core
from .scene import Scene


def core_cloth(scene: Scene) -> _core.Cloth:
    """The cloth as the core takes it."""
    cloth = scene.cloth
    row_spacing, column_spacing = cloth.spacing
    return _core.Cloth(
        rows=cloth.rows,
        columns=cloth.columns,
        row_spacing=row_spacing,
        column_spacing=column_spacing,
        stiffness=cloth.family_stiffness,
        spring_damping=cloth.family_damping,
        drag=cloth.drag,
        mass=cloth.mass_per_point,
        uniform_mass=cloth.uniform_mass,
        pinned=cloth.pinned,
    )
