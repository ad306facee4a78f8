"""`Run.report`: cost, error and extremes of a run. Every report has the same keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .. import _core
from ..engine.options import cached_plan
from ..model.obstacle import name_of_kind
from ..model.scene import Scene
from .error_control import ControlledRun, Estimate
from .reasons import Reason
from .trajectory import Trajectory

_VERSION = _core.build_facts()["version"]
_SUMS = {
    *("steps", "rejected_steps", "force_evaluations", "solution_evaluations"),
    *("wall_time", "force_work", "wind_work"),
}
_PARTS = ("kinetic", "elastic", "gravity", "force", "contact", "total")


def make_report(
    run: Trajectory,
    reason_of_end: str = "",
    controlled: ControlledRun | None = None,
    requested_error: float = math.nan,
    reason_unknown: str = Reason.NOT_ASKED,
) -> dict[str, Any]:
    """Report on a run.

    `reason_of_end` says why it ended early, `controlled` has the outcome of its error estimate, if
    any, and `reason_unknown` says why the error of a whole run is not known.
    """
    scene = run.scene
    state = run.state
    options = run.options
    watched = run.watched
    if controlled:
        error = controlled.error
    elif reason_of_end:
        error = Estimate(reason=Reason.ENDED_EARLY.format(stopped=reason_of_end))
    else:
        error = Estimate(reason=reason_unknown)
    estimate = error._asdict()
    reason = watched.get("reason", "")  # why extremes are not known
    time = watched["first_contact"]
    reason_of_time = ""
    if math.isnan(time):
        reason_of_time = reason if watched["in_contact"] else Reason.UNTOUCHED
    works = watched.get("force_work", {})
    return {
        "steps": run.steps,
        "rejected_steps": run.rejected,
        "force_evaluations": run.evaluations + (controlled.evaluations if controlled else 0),
        "solution_evaluations": run.evaluations,
        "wall_time": run.wall_time,
        "steps_per_second": run.steps / run.wall_time if run.wall_time > 0 else math.inf,
        "dt": run.step,
        "stopped": reason_of_end,
        "residual": math.nan,
        "reason": Reason.NO_REST_ASKED,
        "error_estimate": estimate,
        "tolerance": {
            "asked": requested_error,
            "reached": bool(estimate["rms"] <= requested_error),
        },
        "energy": {**_energy_gain(scene, watched), **_energies_at_ends(run)},
        "force_work": works.get("function", 0.0),
        "wind_work": works.get("wind", 0.0),
        "penetration": {
            "points": watched["point_depth"],
            "triangles": watched["triangle_depth"],
            "reason": reason,
        },
        "stretch": {"largest": watched["stretch"], "reason": reason},
        "first_contact": {"time": time, "reason": reason_of_time},
        "impulse": watched["impulse"],
        "impulse_reason": reason,
        "obstacle_work": watched["obstacle_work"],
        "kernel": state.kernel,
        "integrator": options.integrator,
        "as_printed": True in {sphere.as_printed for sphere in scene.spheres},
        "precision": options.precision,
        "threads": state.threads,
        "instruction_set": state.instruction_set,
        "backend": options.backend,
        "version": _VERSION,
    }


def _energies_at_ends(run: Trajectory) -> dict[str, Any]:
    """Return the energies at the start and at the end; NaN and a reason if they are not finite."""
    plan = cached_plan(run.scene, run.options)
    energies: dict[str, Any] = {}
    for moment, k in (("start", 0), ("end", -1)):
        parts = _core.energy(plan, run.x[k], run.v[k], run.t[k])
        values = [*parts, sum(parts)]
        if not math.isfinite(values[-1]):
            values = [math.nan] * len(values)
            energies["reason"] = Reason.TOO_LARGE
        energies[moment] = dict(zip(_PARTS, values, strict=True))
    return energies


def _energy_gain(scene: Scene, watched: Mapping[str, Any]) -> dict[str, Any]:
    gain = watched["energy_gained"]
    if not math.isnan(gain):
        reason = ""
    elif "reason" in watched:
        reason = watched["reason"]
    elif scene.cloth.driven:
        reason = Reason.DRIVEN
    elif watched["responded"]:
        reason = Reason.RESPONDED.format(kind=name_of_kind(scene.spheres))
    else:
        reason = Reason.NO_STEP
    return {"gained": gain, "reason": reason}


def join_reports(first: Any, second: Any) -> dict[str, Any]:
    """Combine the reports of a run and of the run that continues it."""
    sums = {name: value + second[name] for name, value in first.items() if name in _SUMS}
    wall_time = sums["wall_time"]
    energies = {**second["energy"], "start": first["energy"]["start"]}
    highest = second["energy"]["start"]["total"] + second["energy"]["gained"]
    gain = highest - energies["start"]["total"]
    # The gain of a run is NaN where a response has changed the energy.
    if not math.isnan(gain):
        gain = max(first["energy"]["gained"], gain)
    energies["gained"] = gain
    energies["reason"] = first["energy"]["reason"] or second["energy"]["reason"]
    has_contact = not math.isnan(first["first_contact"]["time"])
    report = {
        **second,
        **sums,
        "steps_per_second": sums["steps"] / wall_time if wall_time > 0 else math.inf,
        "error_estimate": {"max": math.nan, "rms": math.nan, "reason": Reason.RESUMED},
        "tolerance": {"asked": first["tolerance"]["asked"], "reached": False},
        "energy": energies,
        "first_contact": first["first_contact"] if has_contact else second["first_contact"],
        "impulse": [
            [p + q for p, q in zip(*impulses)]
            for impulses in zip(first["impulse"], second["impulse"])
        ],
        "obstacle_work": [p + q for p, q in zip(first["obstacle_work"], second["obstacle_work"])],
    }
    for name in ("penetration", "stretch"):
        # Texts are reasons, which are "" or equal.
        report[name] = {key: max(value, second[name][key]) for key, value in first[name].items()}
    return report
