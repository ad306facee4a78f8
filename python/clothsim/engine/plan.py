"""The plan of the core for a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .. import _core
from ..model.as_core import core_cloth, core_pins, core_spheres
from .options import Options

if TYPE_CHECKING:
    from ..model.scene import Scene


_MOST_PLANS = 8  # kept for a scene


def kept_plan(scene: Scene, options: Options) -> _core.Plan:
    """The plan of a scene, compiled once: it cannot change."""
    plans: dict[Any, _core.Plan] = scene.__dict__.setdefault("_plans", {})
    key = options.precision, options.kernel, options.integrator, _core.choose_instruction_set("")
    plan = plans.get(key)
    if plan is None:
        if len(plans) >= _MOST_PLANS:
            plans.pop(next(iter(plans)), None)
        plan = plans[key] = core_plan(scene, options)
    return plan


def core_plan(scene: Scene, options: Options) -> _core.Plan:
    """The scene as the core takes it, with the kernels of the chosen instruction set."""
    return _core.Plan(
        cloth=core_cloth(scene.cloth),
        gravity=scene.gravity,
        force=scene.force,
        **core_pins(scene),
        spheres=core_spheres(scene),
        precision=options.precision,
        kernel=options.chosen_kernel,
        instruction_set="",
        integrator=options.integrator,
    )
