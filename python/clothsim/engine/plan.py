"""The plan of the core for a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .. import _core
from ..model.as_core import core_cloth, core_motion, core_pins
from .options import Options

if TYPE_CHECKING:
    from ..model.scene import Scene
    from ..model.sphere import Sphere


def point_radius(sphere: Sphere, cloth: Any) -> float:
    """Contact radius of mass points. With offset "face" it is the true radius, because triangles are tested apart."""
    return sphere.radius if sphere.offset == "face" else sphere.contact_radius(cloth)


def core_plan(scene: Scene, options: Options) -> _core.Plan:
    """The scene as the core takes it, with the kernels of the chosen instruction set."""
    return _core.Plan(
        cloth=core_cloth(scene),
        gravity=scene.gravity,
        force=scene.force,
        **core_pins(scene),
        spheres=[
            _core.Sphere(
                center=sphere.center,
                radius=sphere.radius,
                contact_radius=point_radius(sphere, scene.cloth),
                response=sphere.response,
                as_printed=sphere.as_printed,
                restitution=sphere.restitution,
                friction=sphere.friction,
                motion=core_motion(sphere.motion),
                faces=sphere.offset == "face",
                push_out_speed=sphere.push_out_speed,
            )
            for sphere in scene.spheres
        ],
        precision=options.precision,
        kernel=options.kernel_for(scene.cloth),
        strict=options.strict,
        instruction_set="",
        integrator=options.integrator,
    )
