"""Runs of methods on one scene: their errors, and their times in turns; as a Dataset."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base.build import build_config
from ..errors import OrderWarning, StabilityWarning, UnstableError
from ..measure.measures import energy
from ..model.scene import Scene
from .methods import OWN, Method, Outcome
from .solution import Reference

if TYPE_CHECKING:
    import xarray


# A run that takes longer is not repeated.
_LONG = 2.0  # s


@dataclass
class Measured:
    """A method at a setting: its error, and the times seen so far."""

    method: Method
    setting: float
    rms: float = math.inf
    max: float = math.inf
    force_evaluations: int = 0
    energy_drift: float = math.nan
    once: float = 0.0  # wall time of the first run [s]
    seconds: list[float] = field(default_factory=list)

    @property
    def fastest(self) -> float:
        """Least wall time seen [s]; NaN without any."""
        return min(self.seconds, default=math.nan)

    @property
    def stable(self) -> bool:
        return math.isfinite(self.rms)


class Bench:
    """Runs methods on one scene, to the time of the last frame of `solution`, and keeps errors and times."""

    def __init__(self, scene: Scene, solution: Reference) -> None:
        self.scene, self.solution = scene, solution
        self.duration = float(solution.t[-1])
        self.energy = energy(scene, solution.x[-1], solution.v[-1])["total"]

    def first(self, method: Method, setting: float) -> Measured:
        """Measure the error of a run. Its time does not count, because a first run compiles code and fills caches."""
        result = Measured(method, setting)
        outcome = self._solve(result)
        if outcome is not None and np.isfinite(outcome.x).all():
            error = self.solution.error_of(outcome.x)
            result.rms, result.max = error["rms"], error["max"]
            result.force_evaluations = outcome.force_evaluations
            total = energy(self.scene, outcome.x, outcome.v)["total"]
            result.energy_drift = float(total - self.energy)
            result.once = outcome.seconds
        return result

    def time(self, results: Sequence[Measured], windows: int) -> Iterator[Measured]:
        """Time every stable run `windows` times.

        Each round has another order: a slow spell of the machine affects all runs, and none always follows a certain other.
        """
        stable, shuffle = [one for one in results if one.stable], Random(0).shuffle
        for _ in range(windows):
            shuffle(stable)
            for one in stable:
                if not (one.seconds and one.fastest > _LONG):
                    outcome = self._solve(one)
                    if outcome is not None:
                        one.seconds.append(outcome.seconds)
                yield one

    def _solve(self, one: Measured) -> Outcome | None:
        try:
            with warnings.catch_warnings():
                # The run shows whether a step above the guarantee is stable here, and what an order does to the error.
                warnings.simplefilter("ignore", StabilityWarning)
                warnings.simplefilter("ignore", OrderWarning)
                return one.method.solve(self.scene, self.duration, one.setting)
        except (UnstableError, ArithmeticError):
            return None


def pareto(rms: npt.ArrayLike, cost: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """True at the points that no other point beats in both error and cost (the Pareto front).

    Both arrays have one shape. A point that is not finite in both is beaten.

    >>> pareto([1e-3, 1e-6, 1e-5, 1e-9], [1.0, 2.0, 3.0, 4.0]).tolist()
    [True, True, False, True]
    """
    rms, cost = np.asarray(rms, dtype=float), np.asarray(cost, dtype=float)
    front = np.zeros(rms.shape, dtype=bool)
    best = math.inf
    for k in np.lexsort((rms.ravel(), cost.ravel())):
        at = np.unravel_index(k, rms.shape)
        if np.isfinite(rms[at]) and np.isfinite(cost[at]) and rms[at] < best:
            front[at] = True
            best = float(rms[at])
    return front


def label(method: Method) -> str:
    """Label of a method: its name and precision; for a peer also its number of threads."""
    threads = f", {method.threads} threads" if method.library != OWN and method.threads != 1 else ""
    return f"{method.name} {method.precision}{threads if method.threads else ''}"


def dataset(xr: Any, bench: Bench, methods: list[Method], results: dict[tuple[int, int], Measured]) -> xarray.Dataset:
    """Dataset of `work_precision` returns."""
    shape = len(methods), 1 + max(n for _, n in results)
    duration = bench.duration

    def table(value: Any) -> npt.NDArray[np.float64]:
        array = np.full(shape, np.nan)
        for at, one in results.items():
            array[at] = value(one)
        return array

    rms, wall_time = table(lambda r: r.rms), table(lambda r: r.fastest / duration)
    own = np.array([m.library == OWN for m in methods])
    columns = {
        "setting": (table(lambda r: r.setting), "dt [s] or relative tolerance", ""),
        "rms_error": (rms, "rms distance from the reference at the end", "m"),
        "max_error": (table(lambda r: r.max), "largest distance from the reference", "m"),
        "force_evaluations": (table(lambda r: r.force_evaluations), "force evaluations", "1"),
        "wall_time": (wall_time, "wall time per simulated second", "s/s"),
        "energy_drift": (table(lambda r: r.energy_drift), "total energy less the reference's", "J"),
        "pareto": (pareto(np.where(own[:, None], rms, np.nan), wall_time), "on the front of clothsim's methods", ""),
        "pareto_all": (pareto(rms, wall_time), "on the front of all methods", ""),
    }
    solution = bench.solution
    found: xarray.Dataset = xr.Dataset(
        {
            name: (("solver", "level"), values, {"long_name": text, "units": unit})
            for name, (values, text, unit) in columns.items()
        },
        {
            "solver": [label(m) for m in methods],
            "level": np.arange(shape[1]),
            "integrator": ("solver", [m.name for m in methods]),
            "precision": ("solver", [m.precision for m in methods]),
            "library": ("solver", [m.library for m in methods]),
            "threads": ("solver", [m.threads or 0 for m in methods]),
            "control": ("solver", [m.control for m in methods]),
        },
        {
            "scene": json.dumps(bench.scene.to_dict()),
            "duration": duration,
            "reference_error_estimate_rms": float(solution.error_estimate["rms"][-1]),
            "reference_error_bound_rms": float(solution.error_bound["rms"][-1]),
            "instruction_set": build_config()["instruction_set"],
            "version": build_config()["version"],
        },
    )
    return found
