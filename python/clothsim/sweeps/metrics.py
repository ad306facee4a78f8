"""Measures of every member: metrics by name, or any function of the run; and the reference of the metric "error".

The reference is the solution in double with which `cs.reference` checks its own. Its bound is twice the change by the last
halving of the step, plus a unit in the last place. After a contact the motion is chaotic, and there is no solution to
compare with (`incomparable`). It depends on the cloth alone, never on other members of a sweep. Members that differ in
numerics share it, and each process keeps the last references.
"""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..accuracy.solution import distances, solve_in_double
from ..base import Floats, check
from ..model.scene import Scene
from ..run.result import Run
from ..run.settle import settle
from .grid import digest

_lock = threading.Lock()


@dataclass(frozen=True)
class Reference:
    """Positions at the end [m] and a bound of their error [m]; NaN where there is none.

    `contact`: whether a sphere has responded on the way.
    """

    x: Floats
    error: float
    contact: bool = False


def incomparable(run: Run, reference: Reference) -> str:
    """Why the run cannot be compared with the reference, or ""."""
    contact = not math.isnan(run.report["first_contact"]["time"])
    if not (contact or reference.contact):
        return ""
    whose = "the member" if contact else "the reference"
    return (
        f"metric 'error': a sphere has responded to a mass point of {whose}; after contact trajectories "
        "are chaotic and there is no reference; compare outcomes (penetration, first_contact, "
        "energy_drift) or take a shorter duration"
    )


def solve(scene: Scene, duration: float, threads: int | None = 1) -> Reference:
    """The reference of one scene at `duration`."""
    found = solve_in_double(scene, [duration], threads)
    x = found.x[-1]
    # Both runs may err by rounding, each as much as the other.
    return Reference(x, float(2 * found.change[-1] + np.spacing(np.abs(x).max())), found.ended.contact)


@functools.lru_cache(maxsize=64)
def _slot(key: str) -> tuple[threading.Lock, list[Reference]]:
    return threading.Lock(), []


def reference_of(scene: Scene, duration: float, threads: int | None = 1) -> Reference:
    """The reference of a scene, which this process computes once: a second thread waits for the first."""
    with _lock:
        making, found = _slot(digest([scene, duration]))
    with making:
        if not found:
            found.append(solve(scene, duration, threads))
    return found[0]


@dataclass(frozen=True)
class Metric:
    """A named metric: a function of a run and a reference, the attributes of its variables, and what it needs besides the
    report ("reference": a solution to compare with).
    """

    name: str
    compute: Callable[[Run, Any], Mapping[str, Any]]
    variables: Mapping[str, Mapping[str, str]]
    needs: tuple[str, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return named, (self.name,)


def _attrs(long_name: str, units: str = "1") -> dict[str, str]:
    return {"long_name": long_name, "units": units}


def _reported(name: str, **variables: tuple[str, str, str, str]) -> Metric:
    """A metric of figures in the report: for each variable the two keys, the long name and the unit."""

    def compute(run: Any, _: Any) -> dict[str, float]:
        return {name: run.report[entry][key] for name, (entry, key, *_) in variables.items()}

    return Metric(name, compute, {name: _attrs(*attrs) for name, (_, _, *attrs) in variables.items()})


def _error(run: Run, reference: Reference) -> dict[str, float]:
    if incomparable(run, reference):
        return dict.fromkeys(("error", "error_rms", "reference_error"), np.nan)
    found = distances(run.x[-1], reference.x)
    return {"error": float(found["max"]), "error_rms": float(found["rms"]), "reference_error": reference.error}


def _energy_drift(run: Run, _: Any) -> dict[str, float]:
    energy = run.report["energy"]
    return {"energy_drift": energy["end"]["total"] - energy["start"]["total"]}


def _sag(run: Run, _: Any) -> dict[str, float]:
    """Of the rest state, which does not depend on the run; NaN where the scene does not rest."""
    gravity = run.scene.gravity
    pull = np.linalg.norm(gravity)
    rest = settle(run.scene) if pull else None
    if rest is None or rest.report["reason"]:
        return {"sag": np.nan}
    return {"sag": float(((rest.x[-1] - rest.x[0]) @ gravity).max() / pull)}


def _impulse(run: Run, _: Any) -> dict[str, float]:
    """Of all spheres together."""
    x, y, z = np.reshape(run.report["impulse"], (-1, 3)).sum(axis=0)
    return {"impulse": math.hypot(x, y, z), "impulse_x": x, "impulse_y": y, "impulse_z": z}


_ALL = (
    Metric(
        "error",
        _error,
        {
            "error": _attrs("largest distance of a mass point from the reference at the end", "m"),
            "error_rms": _attrs("rms distance of the mass points from the reference at the end", "m"),
            "reference_error": _attrs("bound of the reference's own error", "m"),
        },
        ("reference",),
    ),
    Metric("energy_drift", _energy_drift, {"energy_drift": _attrs("total energy at the end minus that at the start", "J")}),
    _reported("energy_gained", energy_gained=("energy", "gained", "most energy made of nothing, before any response", "J")),
    _reported(
        "largest_stretch",
        largest_stretch=("stretch", "largest", "stretch l/L - 1 of the most stretched spring at any time", "1"),
    ),
    _reported(
        "penetration",
        penetration=("penetration", "triangles", "depth of the deepest triangle in a sphere at any time", "m"),
        penetration_points=("penetration", "points", "depth of the deepest mass point at any time", "m"),
    ),
    Metric(
        "stable",
        lambda *_: {"stable": True},
        {"stable": {"long_name": "whether the run came to its end without UnstableError"}},
    ),
    Metric(
        "steps_per_second",
        lambda run, _: {"steps_per_second": run.report["steps_per_second"]},
        {"steps_per_second": _attrs("steps over the member's share of its batch's time", "1/s")},
    ),
    Metric("sag", _sag, {"sag": _attrs("largest way along gravity from the initial to the rest state", "m")}),
    _reported("first_contact", first_contact=("first_contact", "time", "end of the first step that a sphere changed", "s")),
    Metric(
        "impulse",
        _impulse,
        {"impulse": _attrs("length of the impulse on all spheres together", "N s")}
        | {f"impulse_{k}": _attrs(f"impulse on all spheres together along {k}", "N s") for k in "xyz"},
    ),
)

DEFAULT_METRICS = ("stable", "energy_drift", "largest_stretch")
RESERVED = ("status", "max_stable_dt", "unstable_step", "unstable_time", "message", "position", "velocity")
"""Variables of every sweep, beside its metrics."""

METRICS = {metric.name: metric for metric in _ALL}
"""The metrics that have a name."""


def named(name: str) -> Metric:
    """The metric of that name, also used to unpickle a metric."""
    return METRICS[name]


@dataclass(frozen=True)
class FunctionMetric:
    """A user's function of a `Run`, as a metric; it pickles if the function does."""

    name: str
    function: Callable[..., Any]
    needs: tuple[str, ...] = ("frames",)
    variables: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # known when the first run is through

    def compute(self, run: Run, _: Any) -> dict[str, Any]:
        result = self.function(run)
        parts = {f"_{key}": value for key, value in result.items()} if isinstance(result, Mapping) else {"": result}
        for value in parts.values():
            if np.asarray(value).dtype.kind not in "biuf":
                accepted = "a number, an array of numbers or a mapping of them"
                raise TypeError(f"metric {self.name!r} must give {accepted}, got {check.shown(value)}")
        return {self.name + part: np.asarray(value, float) for part, value in parts.items()}


def choose_metrics(metrics: Any) -> tuple[Metric | FunctionMetric, ...]:
    """The metrics that the argument `metrics` of `sweep` names."""
    if isinstance(metrics, str) or callable(metrics):
        metrics = (metrics,)
    if not isinstance(metrics, (Mapping, list, tuple)):
        raise TypeError(f"metrics must be names, functions or a mapping of names to functions, got {check.shown(metrics)}")
    chosen: dict[str, Metric | FunctionMetric] = {}
    for name, metric in metrics.items() if isinstance(metrics, Mapping) else [(None, metric) for metric in metrics]:
        if callable(metric):
            name = _function_name(name or getattr(metric, "__name__", None) or type(metric).__name__, metric)
            chosen[name] = FunctionMetric(name, metric)
        else:
            chosen[metric] = named(check.choice("metrics", metric, METRICS))
    return tuple(chosen.values())


def _function_name(name: Any, function: Any) -> str:
    """`name` if a function may give its variable that name."""
    if not isinstance(name, str) or not name.isidentifier():
        raise ValueError(f"metrics: {function!r} needs a name, as in metrics={{'name': function}}, got {name!r}")
    if name in RESERVED or any(name in (metric.name, *metric.variables) for metric in _ALL):
        raise ValueError(f"metrics: a function must not be named {name!r}, which is a variable of sweeps")
    return name


def describe(metric: Metric | FunctionMetric) -> str:
    """A text that identifies a metric in a store."""
    if isinstance(metric, Metric):
        return metric.name
    named = metric.function if hasattr(metric.function, "__qualname__") else type(metric.function)
    return f"{metric.name} = {named.__module__}.{named.__qualname__}"
