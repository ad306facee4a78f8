"""Measures of every member: metrics by name, or any function of the run; and the reference of the metric "error".

The reference is the solution in double with which `cs.reference` checks its own. Its bound is twice the change by the last
halving of the step, plus a unit in the last place. After a contact the motion is chaotic, and there is no solution to
compare with (`incomparable`). It depends on the cloth alone, never on other members of a sweep. Members that differ in
numerics share it, and each process keeps the last references.
"""

from __future__ import annotations

import math
import threading
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..accuracy.in_double import solve_in_double
from ..base import Floats, check
from ..errors import ContactError, UnstableError
from ..measure.measures import energy
from ..model.scene import Scene
from ..run.settle import settle
from .grid import digest
from .member import Member, Outcome, Pause, never

_BYTES_KEPT = 1 << 27


@dataclass(frozen=True)
class Reference:
    """Positions at the end [m] and a bound of their error [m]; NaN where there is none.

    `contact`: whether a sphere has responded on the way.
    """

    x: Floats
    error: float
    contact: bool = False


def incomparable(outcome: Outcome) -> str:
    """Why the member's trajectory cannot be compared with the reference's, or ""."""
    if not (outcome.contact or outcome.reference.contact):
        return ""
    whose = "the member" if outcome.contact else "the reference"
    return (
        f"metric 'error': a sphere has responded to a mass point of {whose}; after contact trajectories "
        "are chaotic and there is no reference; compare outcomes (penetration, first_contact, "
        "energy_drift) or take a shorter duration"
    )


def solve(scene: Scene, duration: float, threads: int | None = 1, pause: Pause = never) -> Reference:
    """The reference of one scene at `duration`."""
    try:
        found = solve_in_double(scene, [duration], threads, pause)
    except (UnstableError, ContactError):
        return Reference(np.full_like(scene.initial_position, np.nan), math.nan)
    # Both runs may err by rounding, each as much as the other.
    x = found.x[-1]
    return Reference(x, float(2 * found.change[-1] + np.spacing(np.abs(x).max())), found.contact)


class References:
    """The references that this process has, the last used last; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._making: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self._references: dict[str, Reference] = {}

    def of(self, member: Member, threads: int | None = 1, pause: Pause = never) -> Reference:
        """The reference of a member; a Stopped that `pause` raises passes through."""
        key = digest([member.scene, member.duration])
        with self._lock:
            making = self._making[key]
        with making:  # the second thread waits for the first, which does the same work
            reference = self._references.get(key) or solve(member.scene, member.duration, threads, pause)
            with self._lock:
                self._references.pop(key, None)
                self._references[key] = reference
                while len(kept := self._references) > 1 and sum(one.x.nbytes for one in kept.values()) > _BYTES_KEPT:
                    self._making.pop(oldest := next(iter(kept)), None)
                    del kept[oldest]
            return reference


references = References()


@dataclass(frozen=True)
class Metric:
    """A named metric: its variables with their attributes, and the data that it needs.

    `needs` has "watch" for depths and stretches during the run, "frames" for the stored frames, and
    "reference" for a solution to compare with.
    """

    name: str
    compute: Callable[[Outcome], Mapping[str, Any]]
    variables: Mapping[str, Mapping[str, str]]
    needs: tuple[str, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return named, (self.name,)


def _error(outcome: Outcome) -> dict[str, float]:
    reference = outcome.reference
    if incomparable(outcome):
        return dict.fromkeys(("error", "error_rms", "reference_error"), np.nan)
    distance = np.linalg.norm(outcome.x[-1] - reference.x, axis=-1)
    return {
        "error": float(distance.max()),
        "error_rms": float(np.sqrt((distance**2).mean())),
        "reference_error": reference.error,
    }


def _energy_drift(outcome: Outcome) -> dict[str, float]:
    states = ([outcome.x[0], outcome.x[-1]], [outcome.v[0], outcome.v[-1]])
    start, end = np.asarray(energy(outcome.scene, *states)["total"])
    return {"energy_drift": float(end - start)}


def _attrs(long_name: str, units: str = "1") -> dict[str, str]:
    return {"long_name": long_name, "units": units}


def _watched(name: str, variables: Mapping[str, tuple[str, str, str]], needs: tuple[str, ...] = ("watch",)) -> Metric:
    """A metric of what the core watches: per variable the key in `Outcome.watched`, the long name and the unit."""
    return Metric(
        name,
        lambda outcome: {variable: outcome.watched[key] for variable, (key, _, _) in variables.items()},
        {variable: _attrs(long_name, unit) for variable, (_, long_name, unit) in variables.items()},
        needs,
    )


def _sag(outcome: Outcome) -> dict[str, float]:
    """Of the rest state, which does not depend on the run; NaN where the scene does not rest."""
    scene, pull = outcome.scene, np.linalg.norm(outcome.scene.gravity)
    if pull == 0:
        return {"sag": np.nan}
    rest = settle(scene)
    if rest.report["reason"]:
        return {"sag": np.nan}
    return {"sag": float(((rest.x[-1] - rest.x[0]) @ scene.gravity).max() / pull)}


def _impulse(outcome: Outcome) -> dict[str, float]:
    """Of all spheres together."""
    x, y, z = np.reshape(outcome.run().report["impulse"], (-1, 3)).sum(axis=0)
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
    _watched(
        "energy_gained", {"energy_gained": ("energy_gained", "most energy made of nothing, before any response", "J")}, ()
    ),
    _watched(
        "largest_stretch", {"largest_stretch": ("stretch", "stretch l/L - 1 of the most stretched spring at any time", "1")}
    ),
    _watched(
        "penetration",
        {
            "penetration": ("triangle_depth", "depth of the deepest triangle in a sphere at any time", "m"),
            "penetration_points": ("point_depth", "depth of the deepest mass point at any time", "m"),
        },
    ),
    Metric(
        "stable",
        lambda outcome: {"stable": outcome.error is None},
        {"stable": {"long_name": "whether the run came to its end without UnstableError"}},
    ),
    Metric(
        "steps_per_second",
        lambda outcome: {"steps_per_second": outcome.steps / max(outcome.seconds, 1e-9)},
        {"steps_per_second": _attrs("steps over the member's share of its batch's time", "1/s")},
    ),
    Metric("sag", _sag, {"sag": _attrs("largest way along gravity from the initial to the rest state", "m")}),
    _watched("first_contact", {"first_contact": ("first_contact", "end of the first step that a sphere changed", "s")}, ()),
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


def listing() -> str:
    """Every metric with its variables and their units, for documentation."""
    parts = []
    for name, metric in METRICS.items():
        unit = next(iter(metric.variables.values())).get("units", "1")
        more = ", ".join(variable for variable in metric.variables if variable != name)
        parts.append(f'"{name}"' + (f" (and {more})" if more else "") + ("" if unit == "1" else f" [{unit}]"))
    return ", ".join(parts)


def named(name: str) -> Metric:
    """The metric of that name, also used to unpickle a metric."""
    return METRICS[name]


@dataclass(frozen=True)
class FunctionMetric:
    """A user's function of a `Run`, as a metric; it pickles if the function does."""

    name: str
    function: Callable[..., Any]
    needs: tuple[str, ...] = ("frames", "watch")
    variables: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # known when the first run is through

    def compute(self, outcome: Outcome) -> dict[str, Any]:
        result = self.function(outcome.run())
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
    if name in METRICS or any(name in metric.variables for metric in _ALL):
        raise ValueError(f"metrics: a function must not be named {name!r}, a metric has that name")
    if name in RESERVED:
        raise ValueError(f"metrics: a function must not be named {name!r}, every sweep has a variable of that name")
    return name


def describe(metric: Metric | FunctionMetric) -> str:
    """A text that identifies a metric in a store."""
    if isinstance(metric, Metric):
        return metric.name
    named = metric.function if hasattr(metric.function, "__qualname__") else type(metric.function)
    return f"{metric.name} = {named.__module__}.{named.__qualname__}"
