"""Measures of every member, by name or as functions of its run, and references for "error".

The reference is the solution in double with which `cs.reference` checks its own. Its bound is twice
the change by the last halving of the step, plus a unit in the last place. After a contact the
motion is chaotic, and there is no solution to compare with (`reason_without_error`). It depends on
the cloth alone, never on other members of a sweep. Members that differ in numerics share it, and
each process keeps the last references.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..accuracy.solution import largest_and_rms_distances, solve_in_double
from ..base import Floats, check
from ..model.scene import Scene
from ..run.result import Run
from ..run.settle import settle
from ..typing import Force


class EndReference(NamedTuple):
    """The trusted end of a motion."""

    x: Floats  # positions [m]
    error: float  # bound of their error [m]
    contact: bool  # whether a sphere has responded


def compute_reference(
    scene: Scene, duration: float, threads: int | None = 1, force: Force | None = None
) -> EndReference:
    """Compute the reference of a scene; with a force each time, else once in a process."""
    if force is None:
        return _cached_reference(scene, duration, threads)
    return _solve_reference(scene, duration, threads, force)


@functools.lru_cache(maxsize=64)
def _cached_reference(scene: Scene, duration: float, threads: int | None) -> EndReference:
    return _solve_reference(scene, duration, threads, None)


def _solve_reference(
    scene: Scene, duration: float, threads: int | None, force: Force | None
) -> EndReference:
    solution = solve_in_double(scene, [duration], threads, force)
    x = solution.x[-1]
    # Both runs may err by rounding, each as much as the other.
    error = float(2 * solution.change[-1] + np.spacing(np.abs(x).max()))
    return EndReference(x, error, solution.finest.contact)


def reason_without_error(run: Run, reference: EndReference) -> str:
    """Say why the run cannot be compared with the reference, or return ""."""
    contact = not math.isnan(run.report["first_contact"]["time"])
    if not (contact or reference.contact):
        return ""
    owner = "the member" if contact else "the reference"
    return (
        f"metric 'error': a sphere has responded to a mass point of {owner}; after contact "
        "trajectories are chaotic and there is no reference; compare outcomes (penetration, "
        "first_contact, energy_drift) or take a shorter duration"
    )


def _errors_at_end(run: Run, reference: EndReference) -> tuple[float, ...]:
    if reason_without_error(run, reference):
        return math.nan, math.nan, math.nan
    distance = largest_and_rms_distances(run.x[-1], reference.x)
    return float(distance["max"]), float(distance["rms"]), reference.error


def _measure_rest_sag(run: Run, _: Any) -> tuple[float]:
    """Measure the sag of the rest state, which does not depend on the run; NaN if there is none."""
    gravity = run.scene.gravity
    pull = np.linalg.norm(gravity)
    rest = settle(run.scene) if pull else None
    if rest is None or rest.report["reason"]:
        return (math.nan,)
    return (float(((rest.x[-1] - rest.x[0]) @ gravity).max() / pull),)


def _total_contact_impulse(run: Run, _: Any) -> tuple[float, ...]:
    x, y, z = np.reshape(run.report["impulse"], (-1, 3)).sum(axis=0)
    return math.hypot(x, y, z), x, y, z


class Metric(NamedTuple):
    """A metric that has a name."""

    compute: Callable[[Run, Any], tuple[Any, ...]]  # values of a run and its reference
    variables: Mapping[str, tuple[str, str]]  # long names and units of the values, by name


METRICS = {
    "error": Metric(
        _errors_at_end,
        {
            "error": ("largest distance of a mass point from the reference at the end", "m"),
            "error_rms": ("rms distance of the mass points from the reference at the end", "m"),
            "reference_error": ("bound of the reference's own error", "m"),
        },
    ),
    "energy_drift": Metric(
        lambda run, _: (
            run.report["energy"]["end"]["total"] - run.report["energy"]["start"]["total"],
        ),
        {"energy_drift": ("total energy at the end minus that at the start", "J")},
    ),
    "energy_gained": Metric(
        lambda run, _: (run.report["energy"]["gained"],),
        {"energy_gained": ("most energy made of nothing, before any response", "J")},
    ),
    "largest_stretch": Metric(
        lambda run, _: (run.report["stretch"]["largest"],),
        {"largest_stretch": ("stretch l/L - 1 of the most stretched spring at any time", "1")},
    ),
    "penetration": Metric(
        lambda run, _: (
            run.report["penetration"]["triangles"],
            run.report["penetration"]["points"],
        ),
        {
            "penetration": ("depth of the deepest triangle in a sphere at any time", "m"),
            "penetration_points": ("depth of the deepest mass point at any time", "m"),
        },
    ),
    "stable": Metric(
        lambda *_: (True,),
        {"stable": ("whether the run came to its end without UnstableError", "")},
    ),
    "steps_per_second": Metric(
        lambda run, _: (run.report["steps_per_second"],),
        {"steps_per_second": ("steps over the member's share of its batch's time", "1/s")},
    ),
    "sag": Metric(
        _measure_rest_sag,
        {"sag": ("largest way along gravity from the initial to the rest state", "m")},
    ),
    "first_contact": Metric(
        lambda run, _: (run.report["first_contact"]["time"],),
        {"first_contact": ("end of the first step that a sphere changed", "s")},
    ),
    "impulse": Metric(
        _total_contact_impulse,
        {"impulse": ("length of the impulse on all spheres together", "N s")}
        | {f"impulse_{k}": (f"impulse on all spheres together along {k}", "N s") for k in "xyz"},
    ),
}
"""The metrics that have a name."""

DEFAULT_METRICS = ("stable", "energy_drift", "largest_stretch")
RESERVED = ("status", "max_stable_dt", "unstable_step", "unstable_time", "message")
"""Variables of every sweep, beside its metrics."""

# A name of `METRICS` stands for None here, another name for a user's function.
Metrics = Mapping[str, Callable[[Run], Any] | None]


def compute_variables(name: str, function: Callable[[Run], Any], run: Run) -> dict[str, Any]:
    """Compute the variables of a user's function of a run."""
    result = function(run)
    parts = {name: result}
    if isinstance(result, Mapping):
        parts = {f"{name}_{key}": value for key, value in result.items()}
    for value in parts.values():
        if np.asarray(value).dtype.kind not in "biuf":
            requirement = "a number, an array of numbers or a mapping of them"
            raise TypeError(
                f"metric {name!r} must give {requirement}, got {check.value_text(value)}"
            )
    return {part: np.asarray(value, float) for part, value in parts.items()}


def choose_metrics(metrics: Any) -> Metrics:
    """Look up the metrics that the argument `metrics` of `sweep` names."""
    if isinstance(metrics, str) or callable(metrics):
        metrics = (metrics,)
    if not isinstance(metrics, (Mapping, list, tuple)):
        raise TypeError(
            "metrics must be names, functions or a mapping of names to functions, got "
            f"{check.value_text(metrics)}"
        )
    pairs = [(None, metric) for metric in metrics]
    if isinstance(metrics, Mapping):
        pairs = list(metrics.items())
    choice: dict[str, Callable[[Run], Any] | None] = {}
    for name, metric in pairs:
        if callable(metric):
            name = name or getattr(metric, "__name__", None) or type(metric).__name__
            choice[_check_function_name(name, metric)] = metric
        else:
            choice[check.choice("metrics", metric, METRICS)] = None
    return choice


def _check_function_name(name: Any, function: Any) -> str:
    """Return `name` if a function may give its variable that name."""
    if not isinstance(name, str) or not name.isidentifier():
        raise ValueError(
            f"metrics: {function!r} needs a name, as in metrics={{'name': function}}, got {name!r}"
        )
    variables = {variable for metric in METRICS.values() for variable in metric.variables}
    if name in {*RESERVED, *METRICS, *variables}:
        raise ValueError(
            f"metrics: a function must not be named {name!r}, which is a variable of sweeps"
        )
    return name


def metric_identity(name: str, function: Any) -> str:
    """Make a text that identifies a metric in a store."""
    if function is None:
        return name
    source = function if hasattr(function, "__qualname__") else type(function)
    return f"{name} = {source.__module__}.{source.__qualname__}"
