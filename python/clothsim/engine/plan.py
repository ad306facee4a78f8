"""From a scene to what the core computes: kernels, threads, and an account of both."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .. import _core
from ..base import check
from ..model.motion import Keyframes, Linear, Reciprocate
from ..typing import Backend, Kernel, Precision
from .integration import Integrator, integrator_name, integrators

if TYPE_CHECKING:
    from ..model.scene import Scene
    from ..model.sphere import Sphere

PRECISIONS: tuple[Precision, ...] = ("double", "single")
KERNELS: tuple[Kernel, ...] = ("auto", "gather", "edge")
INTEGRATORS = tuple(integrators())
BACKENDS: tuple[Backend, ...] = ("cpu", "gpu")

# Fewer mass points than this are stepped faster by one thread: that threads wait for each other in
# each of a step's four stages costs more than the second one saves.
_POINTS_WORTH_A_THREAD = 128

# Floating-point operations, a root and a division counted as one each.
_FLOPS_SPRING = 19
_FLOPS_SPRING_DAMPING = 11
_FLOPS_POINT_DAMPING = 6
_FLOPS_POINT_MASS = 3
_FLOPS_ACCELERATION = 6
_FLOPS_RK4_POINT = 81  # of a whole step of the fused kernel
_FLOPS_UPDATE = 6  # a vector times a number, added to a vector
_FLOPS_COMPENSATION = 18
_FLOPS_SPHERE_TEST = 9
# Such updates in a step of each method without and with damping (cpp/dynamics/methods.cpp): of x one for
# the velocity and one per weight that is not 0, of v one per weight that is not 0.
_UPDATES = {
    "semi_implicit_euler": (2, 2),
    "velocity_verlet": (3, 7),
    "pefrl": (9, 9),
    "dopri5": (40, 40),
    "dop853": (126, 126),
}


def choose_kernel(kernel: str, strict: bool) -> str:
    """The kernel that "auto" stands for: the fast one, unless the strict class is asked for."""
    return kernel if kernel != "auto" else "gather" if strict else "edge"


def check_options(precision: str, kernel: str, strict: bool, integrator: str = "rk4") -> str:
    """Raise the errors of arguments that every stepping function takes; the integrator's name."""
    check.choice("precision", precision, PRECISIONS)
    check.choice("kernel", kernel, KERNELS)
    integrator = integrator_name(integrator)
    if check.boolean("strict", strict) and kernel == "edge":
        raise ValueError("kernel must be 'gather' or 'auto' with strict=True, got 'edge'")
    return integrator


def check_backend(backend: str, kernel: str, threads: int | None, integrator: str) -> None:
    """Raise the errors of a backend and of options that it does not have."""
    if check.choice("backend", backend, BACKENDS) == "cpu":
        return
    if integrator != "rk4":
        raise ValueError(f"integrator must be 'rk4' with backend 'gpu', got {integrator!r}")
    if kernel == "edge":
        raise ValueError("kernel must be 'gather' or 'auto' with backend 'gpu', got 'edge'")
    if threads is not None:
        raise ValueError(f"threads must be None with backend 'gpu', got {threads!r}")


def choose_threads(threads: int | None, shape: tuple[int, int], members: int = 1) -> int:
    """The number of threads used: `threads` checked, or a choice by size where it is None."""
    if threads is not None:
        return check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
    rows, columns = shape
    if members > 1:  # a thread each, or the whole team for those left over
        parts = max(members, rows * columns // _core.points_worth_a_thread)
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
    """Distance at which a mass point is answered; with offset "face" triangles ask for more."""
    return sphere.radius if sphere.offset == "face" else sphere.contact_radius(cloth)


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
        point_damping=cloth.point_damping,
        mass=cloth.mass_per_point,
        uniform_mass=cloth.uniform_mass,
        pinned=cloth.pinned,
    )


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
                literal=sphere.literal,
                restitution=sphere.restitution,
                friction=sphere.friction,
                motion=_core_motion(sphere),
                faces=sphere.offset == "face",
                push_out_speed=sphere.push_out_speed,
            )
            for sphere in scene.spheres
        ],
        precision=precision,
        kernel=choose_kernel(kernel, strict),
        strict=strict,
        instruction_set="",
        integrator=integrator,
    )


class Explanation(Mapping[str, Any]):
    """Work of a step of a scene, and the parts left out: a mapping that prints as a text.

    Examples
    --------
    >>> import clothsim as cs
    >>> account = cs.scenes.paper_swing().explain()
    >>> account["springs"], account["left_out"]
    (3906, ('bend springs', 'point damping', 'mass per point', 'spheres', 'compensation'))
    """

    def __init__(self, facts: dict[str, Any]) -> None:
        self._facts = facts

    def __getitem__(self, key: str) -> Any:
        return self._facts[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._facts)

    def __len__(self) -> int:
        return len(self._facts)

    def __str__(self) -> str:
        width = max(map(len, self._facts))
        lines = (f"{name.replace('_', ' '):<{width}}  {_text(v)}" for name, v in self.items())
        return "\n".join(lines)

    __repr__ = __str__


def _text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ", ".join(map(str, value)) or "nothing"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(v)}" for name, v in value.items()) or "nothing"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return str(value)


def _flops(scene: Scene, method: Integrator, kernel: str, compensated: bool) -> dict[str, int]:
    """Floating-point operations per step, part by part; of an explicit method."""
    cloth = scene.cloth
    points = cloth.rows * cloth.columns
    evaluations = method.evaluations_per_step(cloth.damped)
    state = _FLOPS_RK4_POINT
    if method.name in _UPDATES:
        state = _FLOPS_UPDATE * _UPDATES[method.name][cloth.damped]
        state += _FLOPS_ACCELERATION * evaluations
    per_point = {
        "state": state,
        "point damping": evaluations * _FLOPS_POINT_DAMPING * (cloth.point_damping > 0),
        "mass per point": evaluations * _FLOPS_POINT_MASS * (not cloth.uniform_mass),
        "compensation": _FLOPS_COMPENSATION * compensated,
        "spheres": _FLOPS_SPHERE_TEST * len(scene.spheres),
    }
    # In the gather kernel each of a spring's two ends evaluates it, as the shader's threads do.
    times = evaluations * (2 if kernel == "gather" else 1)
    flops = {f"{f} springs": times * _FLOPS_SPRING * cloth.spring_count(f) for f in cloth.families}
    if any(cloth.family_damping.values()):
        flops["spring damping"] = times * _FLOPS_SPRING_DAMPING * cloth.spring_count()
    return flops | {name: points * count for name, count in per_point.items() if count}


def explain(
    scene: Scene,
    precision: str = "double",
    kernel: str = "auto",
    threads: int | None = None,
    strict: bool = False,
    integrator: str = "rk4",
) -> Explanation:
    """See `Scene.explain`."""
    from .limiting import limiting_term

    integrator = check_options(precision, kernel, strict, integrator)
    cloth, method = scene.cloth, integrators()[integrator]
    kernel = choose_kernel(kernel, strict)
    plan = core_plan(scene, precision, kernel, strict, integrator)
    compensated = precision == "single"
    everything = {
        "structural springs": "structural" in cloth.families,
        "shear springs": "shear" in cloth.families,
        "bend springs": "bend" in cloth.families,
        "spring damping": any(cloth.family_damping.values()),
        "point damping": cloth.point_damping > 0,
        "mass per point": not cloth.uniform_mass,
        "spheres": bool(scene.spheres),
        "compensation": compensated,
    }
    # The implicit method solves each step by Newton's method: as often as that takes.
    flops = _flops(scene, method, kernel, compensated) if method.explicit else {}
    term = limiting_term(scene, integrator)
    return Explanation(
        {
            "mass_points": cloth.rows * cloth.columns,
            "springs": cloth.spring_count(),
            "computed": tuple(name for name, present in everything.items() if present),
            "left_out": tuple(name for name, present in everything.items() if not present),
            "collision_passes": tuple(
                f"{s.response}{' (literal)' if s.literal else ''}, contact radius "
                f"{point_radius(s, cloth):.6g} m{', triangles' if s.offset == 'face' else ''}"
                for s in scene.spheres
            ),
            "integrator": integrator,
            "order": method.order_of(scene),
            "force_evaluations_per_step": (
                method.evaluations_per_step(cloth.damped) if method.explicit else "as many as Newton's method takes"
            ),
            "max_stable_dt": term.max_stable_dt,
            "limited_by": str(term),
            "kernel": kernel,
            "arithmetic": "strict" if strict else "fused",
            "precision": precision,
            "instruction_set": plan.instruction_set,
            "lanes": plan.lanes,
            "threads": choose_threads(threads, cloth.shape),
            "flops_per_step": sum(flops.values()) if flops else math.nan,
            "flops": flops,
        }
    )
