"""An account of a scene's work per step: kernels, threads, and the stable step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..base.text import align_table
from ..methods.bound import (
    least_rtol_of_rkc2,
    limiting_term,
    stable_dt_in_layer,
    stable_dt_ratio_without_damping,
)
from ..methods.integrators import METHODS, check_integrator_name
from ..model.cloth import FAMILIES
from ..model.scene import Scene
from .options import Options, compile_plan


class Explanation(dict[str, Any]):
    """The work of a step of a scene, and what is left out: a mapping that prints as a text.

    Examples
    --------
    >>> account = cs.scenes.paper_swing().explain()
    >>> account["springs"], account["left_out"][:3]
    (3906, ('bend springs', 'drag', 'mass per point'))
    """

    def __str__(self) -> str:
        return align_table(
            [(name.replace("_", " "), _value_text(value)) for name, value in self.items()],
            left=(0, 1),
        )

    __repr__ = __str__


def _value_text(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return ", ".join(map(_value_text, value)) or "nothing"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_value_text(v)}" for name, v in value.items()) or "nothing"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return str(value)


def _layer_text(scene: Scene, k: int, integrator: str) -> str:
    layer = scene.spheres[k].layer(scene.cloth)
    h = layer["thickness"]
    limit = stable_dt_in_layer(scene, integrator, k, h)
    return (
        f"a {scene.spheres[k]._kind}, spheres[{k}]: thickness {h:.3g} m, stiffness "
        f"{layer['stiffness']:.4g} N/m, dissipation {layer['dissipation']:.3g} s/m, friction "
        f"{scene.spheres[k].friction:g}; dt up to {limit:.3g} s is stable in all of it"
    )


def _method_chosen_for_tolerance(scene: Scene) -> str:
    """Return the method that `simulate` chooses where an error is asked for."""
    least = least_rtol_of_rkc2(scene)
    if math.isinf(least):
        if scene.damped or scene.spheres or scene.cloth.driven:
            return "dop853"
        return "velocity_verlet at parts of its stable step where these meet it, else dop853"
    return (
        f"rkc2 from rtol {least:g} on, as damping shortens the stable step "
        f"{stable_dt_ratio_without_damping(scene):.1f} times; else dop853"
    )


def explain(
    scene: Scene,
    precision: str = "double",
    kernel: str = "auto",
    threads: int | None = None,
    integrator: str = "rk4",
) -> Explanation:
    """See `Scene.explain`."""
    options = Options(integrator, precision, threads, kernel)
    integrator = check_integrator_name(options.integrator, fixed=True)
    cloth = scene.cloth
    method = METHODS[integrator]
    plan = compile_plan(scene, options)
    stages = method.stages_damped if scene.damped else method.stages
    parts = {
        **{f"{family} springs": family in cloth.springs for family in FAMILIES},
        "spring damping": any(cloth.family_damping.values()),
        "drag": cloth.drag > 0,
        "mass per point": not cloth.uniform_mass,
        "forces on points": scene.force is not None,
        "wind": scene.wind is not None,
        "driven pins": bool(cloth.driven),
        "spheres": any(obstacle._kind == "sphere" for obstacle in scene.spheres),
        "planes": any(obstacle._kind == "plane" for obstacle in scene.spheres),
        "compensation": precision == "single",
    }
    term = limiting_term(scene, integrator)
    return Explanation(
        {
            "mass_points": cloth.rows * cloth.columns,
            "springs": cloth.spring_count(),
            "computed": tuple(name for name, present in parts.items() if present),
            "left_out": tuple(name for name, present in parts.items() if not present),
            "collision_passes": tuple(
                f"{s.response}{' (as printed)' if s.as_printed else ''}, {s._size_text(cloth)}"
                for s in scene.spheres
                if s.response != "penalty"
            ),
            "layers": tuple(
                _layer_text(scene, k, integrator)
                for k, s in enumerate(scene.spheres)
                if s.response == "penalty"
            ),
            "integrator": integrator,
            "with_tolerance": _method_chosen_for_tolerance(scene),
            "order": method.order_of(scene),
            "force_evaluations_per_step": (
                stages if method.explicit else "as many as Newton's method takes"
            ),
            "max_stable_dt": term.max_stable_dt,
            "limited_by": str(term),
            "kernel": options.chosen_kernel,
            "precision": precision,
            "instruction_set": plan.instruction_set,
            "threads": options.thread_count_for(cloth.shape),
        }
    )
