"""The plan of the core for a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .. import _core
from ..model.as_core import core_cloth
from ..model.motion import Keyframes, Linear, Reciprocate
from .options import Options

if TYPE_CHECKING:
    from ..model.scene import Scene
    from ..model.sphere import Sphere


def _core_motion(sphere: Sphere) -> _core.Motion:
    motion = sphere.motion
    if isinstance(motion, Linear):
        return _core.Motion.linear(motion.velocity)
    if isinstance(motion, Reciprocate):
        return _core.Motion.reciprocate(
            motion.unit_direction, motion.distance, motion.period, motion.deceleration, motion.phase
        )
    if isinstance(motion, Keyframes):
        return _core.Motion.keyframes(motion.times.tolist(), list(motion.centers))
    return _core.Motion()


def point_radius(sphere: Sphere, cloth: Any) -> float:
    """Contact radius of mass points. With offset "face" it is the true radius, because triangles are tested apart."""
    return sphere.radius if sphere.offset == "face" else sphere.contact_radius(cloth)


def core_plan(scene: Scene, options: Options) -> _core.Plan:
    """The scene as the core takes it, with the kernels of the chosen instruction set."""
    return _core.Plan(
        cloth=core_cloth(scene),
        gravity=scene.gravity,
        force=scene.force,
        spheres=[
            _core.Sphere(
                center=sphere.center,
                radius=sphere.radius,
                contact_radius=point_radius(sphere, scene.cloth),
                response=sphere.response,
                as_printed=sphere.as_printed,
                restitution=sphere.restitution,
                friction=sphere.friction,
                motion=_core_motion(sphere),
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
