"""The plan of the core for a scene: kernels and threads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .. import _core
from ..base import check
from ..methods.integration import integrator_name, integrators
from ..model.as_core import core_cloth
from ..model.motion import Keyframes, Linear, Reciprocate
from ..typing import Backend, Kernel, Precision

if TYPE_CHECKING:
    from ..model.cloth import Cloth
    from ..model.scene import Scene
    from ..model.sphere import Sphere

PRECISIONS: tuple[Precision, ...] = ("double", "single")
KERNELS: tuple[Kernel, ...] = ("auto", "gather", "edge")
INTEGRATORS = tuple(integrators())
BACKENDS: tuple[Backend, ...] = ("cpu", "gpu")

# Fewer mass points than this are stepped faster by one thread: that threads wait for each other in
# each of a step's four stages costs more than the second one saves.
_POINTS_WORTH_A_THREAD = 128


def choose_kernel(kernel: str, strict: bool, cloth: Cloth) -> str:
    """The kernel that "auto" stands for: "edge", unless the strict class or a family that it lacks needs "gather"."""
    lacking = [family for family in cloth.families if family not in _core.edge_families]
    if kernel == "edge" and lacking:
        raise ValueError(f"kernel must be 'gather' or 'auto' for a cloth with {lacking[0]} springs, got 'edge'")
    return kernel if kernel != "auto" else "gather" if strict or lacking else "edge"


def check_options(precision: str, kernel: str, strict: bool, integrator: str = "rk4") -> str:
    """Check the options that every stepping function takes, and return the integrator's name."""
    check.choice("precision", precision, PRECISIONS)
    check.choice("kernel", kernel, KERNELS)
    integrator = integrator_name(integrator)
    if check.boolean("strict", strict) and kernel == "edge":
        raise ValueError("kernel must be 'gather' or 'auto' with strict=True, got 'edge'")
    return integrator


def check_backend(backend: str, kernel: str, threads: int | None, integrator: str) -> None:
    """Check the backend, and refuse options that it does not have."""
    if check.choice("backend", backend, BACKENDS) == "cpu":
        return
    if integrator != "rk4":
        raise ValueError(f"integrator must be 'rk4' with backend 'gpu', got {integrator!r}")
    if kernel == "edge":
        raise ValueError("kernel must be 'gather' or 'auto' with backend 'gpu', got 'edge'")
    if threads is not None:
        raise ValueError(f"threads must be None with backend 'gpu', got {threads!r}")


def choose_threads(threads: int | None, shape: tuple[int, int], members: int = 1) -> int:
    """The number of threads: `threads` checked; None is a choice by size."""
    if threads is not None:
        return check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
    rows, columns = shape
    if members > 1:  # a thread each, or the whole team for those left over
        parts = max(members, rows * columns // _core.least_points_per_thread)
    else:
        parts = max(1, rows * columns // _POINTS_WORTH_A_THREAD)
    return min(_core.available_threads(), parts)


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


def core_plan(
    scene: Scene, precision: str = "double", kernel: str = "auto", strict: bool = False, integrator: str = "rk4"
) -> _core.Plan:
    """The scene as the core takes it, with the kernels of the chosen instruction set."""
    return _core.Plan(
        cloth=core_cloth(scene),
        gravity=scene.gravity,
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
        precision=precision,
        kernel=choose_kernel(kernel, strict, scene.cloth),
        strict=strict,
        instruction_set="",
        integrator=integrator,
    )
