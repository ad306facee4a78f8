"""Measures of every member: metrics by name, or any function of the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import check
from ..measure.measures import energy
from .member import Outcome
from .reference import incomparable


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
    Metric(
        "energy_gained",
        lambda outcome: {"energy_gained": outcome.watched["energy_gained"]},
        {"energy_gained": _attrs("most energy made of nothing, before any response", "J")},
    ),
    Metric(
        "largest_stretch",
        lambda outcome: {"largest_stretch": outcome.watched["stretch"]},
        {"largest_stretch": _attrs("stretch l/L - 1 of the most stretched spring at any time")},
        ("watch",),
    ),
    Metric(
        "penetration",
        lambda outcome: {
            "penetration": outcome.watched["triangle_depth"],
            "penetration_points": outcome.watched["point_depth"],
        },
        {
            "penetration": _attrs("depth of the deepest triangle in a sphere at any time", "m"),
            "penetration_points": _attrs("depth of the deepest mass point at any time", "m"),
        },
        ("watch",),
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
    Metric(
        "first_contact",
        lambda outcome: {"first_contact": outcome.watched["first_contact"]},
        {"first_contact": _attrs("end of the first step that a sphere changed", "s")},
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
    for metric in _ALL:
        units = next(iter(metric.variables.values())).get("units", "1")
        more = [name for name in metric.variables if name != metric.name]
        given = f" (and {', '.join(more)})" if more else ""
        parts.append(f'"{metric.name}"{given}{"" if units == "1" else f" [{units}]"}')
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

    @property
    def variables(self) -> dict[str, dict[str, str]]:
        return {}  # known when the first run is through

    def compute(self, outcome: Outcome) -> dict[str, Any]:
        result = self.function(outcome.run())
        if not isinstance(result, Mapping):
            return {self.name: self._number(result)}
        return {f"{self.name}_{key}": self._number(value) for key, value in result.items()}

    def _number(self, value: Any) -> Any:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise TypeError(
                f"metric {self.name!r} must give a number, an array of numbers or a mapping of "
                f"them, got {check.shown(value)}"
            )
        return array.astype(np.float64)


def choose_metrics(metrics: Any) -> tuple[Metric | FunctionMetric, ...]:
    """The metrics that the argument `metrics` of `sweep` names."""
    if isinstance(metrics, str) or callable(metrics):
        metrics = (metrics,)
    if isinstance(metrics, Mapping):
        pairs = list(metrics.items())
    elif isinstance(metrics, (list, tuple)):
        pairs = [(None, metric) for metric in metrics]
    else:
        raise TypeError(f"metrics must be names, functions or a mapping of names to functions, got {check.shown(metrics)}")
    chosen: dict[str, Metric | FunctionMetric] = {}
    for name, metric in pairs:
        if callable(metric):
            name = name or getattr(metric, "__name__", None) or type(metric).__name__
            name = check_function_name(name, metric)
            chosen[name] = FunctionMetric(name, metric)
        else:
            metric = check.choice("metrics", metric, METRICS)
            chosen[metric] = METRICS[metric]
    return tuple(chosen.values())


def check_function_name(name: Any, function: Any) -> str:
    """`name` if a function may give its variable that name."""
    taken = {variable for metric in _ALL for variable in metric.variables} | set(METRICS)
    if not isinstance(name, str) or not name.isidentifier():
        raise ValueError(f"metrics: {function!r} needs a name, as in metrics={{'name': function}}, got {name!r}")
    if name in taken:
        raise ValueError(f"metrics: a function must not be named {name!r}, a metric has that name")
    if name in RESERVED:
        raise ValueError(f"metrics: a function must not be named {name!r}, every sweep has a variable of that name")
    return name


def describe(metric: Metric | FunctionMetric) -> str:
    """A text that identifies a metric in a store."""
    if isinstance(metric, Metric):
        return metric.name
    function = metric.function
    where = getattr(function, "__module__", type(function).__module__)
    name = getattr(function, "__qualname__", type(function).__qualname__)
    return f"{metric.name} = {where}.{name}"
