"""Entries of a run's report about its error and its cost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from .. import _core
from ..base import Floats
from ..machine.build import build_config
from ..measure.measures import energy
from ..model.as_core import core_cloth
from ..model.scene import Scene
from ..typing import Report
from .attempts import NOT_ASKED, Controlled, Estimate
from .recording import Solution

Account = dict[str, Any]


def of_nothing(reason: str = "") -> Account:
    """The entries of a run whose error was not estimated."""
    return _account(Estimate.unknown(reason or NOT_ASKED), math.nan, 0, 0.0)


def of_controlled(found: Controlled, asked: float = math.nan) -> Account:
    """The entries of a run whose error was estimated, with or without a tolerance."""
    return _account(found.error, asked, found.evaluations, found.wall_time)


def _account(error: Estimate, asked: float, evaluations: int, wall_time: float) -> Account:
    return {
        "error_estimate": vars(error).copy(),
        "estimate_evaluations": evaluations,
        "estimate_wall_time": wall_time,
        "tolerance": {"asked": asked, "reached": bool(error.rms <= asked)},
    }


def report(scene: Scene, solution: Solution, account: Account, stopped: str = "") -> Report:
    """Build `Run.report`; `stopped` says why the run ended early."""
    x, v = solution.x, solution.v
    wall_time, options, state = solution.wall_time, solution.options, solution.state
    found = {
        "steps": solution.steps,
        "rejected_steps": solution.rejected,
        "force_evaluations": solution.evaluations + account["estimate_evaluations"],
        "solution_evaluations": solution.evaluations,
        "wall_time": wall_time,
        "steps_per_second": solution.steps / wall_time if wall_time > 0 else math.inf,
        "dt": solution.step,
        "stopped": stopped,
        "residual": math.nan,
        "reason": "not a run to rest: settle finds the rest state",
        **account,
        "energy": {**_gained(scene, solution.watched), **_energies(scene, x, v)},
        **_extremes(solution.watched),
        "kernel": state.kernel,
        "integrator": options.integrator,
        "as_printed": any(sphere.as_printed for sphere in scene.spheres),
        "precision": options.precision,
        "threads": state.threads,
        "instruction_set": state.instruction_set,
        "backend": options.backend,
        "version": build_config()["version"],
    }
    return cast(Report, found)


def _extremes(watched: Mapping[str, Any]) -> dict[str, Any]:
    """Measures of the core, in the form of the report."""
    missing = watched.get("reason", "")
    none = "" if watched["in_contact"] else "no sphere responded"
    time = watched["first_contact"]
    return {
        "penetration": {"points": watched["point_depth"], "triangles": watched["triangle_depth"], "reason": missing},
        "stretch": {"largest": watched["stretch"], "reason": missing},
        "first_contact": {"time": time, "reason": (none or missing) if math.isnan(time) else ""},
        "impulse": watched["impulse"],
        "impulse_reason": missing,
    }


def _energies(scene: Scene, x: Floats, v: Floats) -> dict[str, Any]:
    """The energies at the start and at the end; NaN with a reason where they are not finite."""
    cloth, found = core_cloth(scene.cloth), dict[str, Any]()
    for moment, k in (("start", 0), ("end", -1)):
        parts = np.array(_core.energy(cloth, scene.gravity, scene.force, x[k], v[k]))
        values = [*parts.tolist(), float(parts.sum())]
        if not math.isfinite(values[-1]):
            values = [math.nan] * 5
            try:
                energy(scene, x[k], v[k])
            except ValueError as error:
                found["reason"] = str(error)
        found[moment] = dict(zip(("kinetic", "elastic", "gravity", "force", "total"), values, strict=True))
    return found


def _gained(scene: Scene, watched: Mapping[str, Any]) -> dict[str, Any]:
    gained, reason = watched["energy_gained"], ""
    if math.isnan(gained):
        pins = "driven pins do work on the cloth" if scene.cloth.driven else ""
        contact = "a sphere responded, and responses change the energy" if watched["in_contact"] else "no step was taken"
        reason = watched.get("reason", "") or pins or contact
    return {"gained": gained, "reason": reason}
