"""Runs of methods on one scene: their errors, and their times in turns."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.clocks import turns
from ..errors import OrderWarning, StabilityWarning, UnstableError
from ..measure.measures import energy
from ..model.scene import Scene
from .methods import Method, Outcome
from .solution import Reference

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
        """Time every stable run `windows` times. The runs take turns."""
        stable = [one for one in results if one.stable]
        for k in turns(len(stable), windows):
            one = stable[k]
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
