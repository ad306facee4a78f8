"""Error control of named methods: runs are compared with a better run of dop853.

The tolerance of the better run is tightened until its own error is at most `SMALL` times the
distance of both. Its own error is the sum of its local errors times their growth. The growth is
known once it has been tightened: it is the distance of two better runs over the local errors of the
looser run. The first run of a fixed step takes the guaranteed stable step. Its error and the order of
the method then give the step that is needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..errors import UnstableError
from ..methods.integration import integrators
from .attempts import MANY_STEPS, MARGIN, MOST, ORDER, ROUNDING, RUNS, SMALL, Attempts, Controlled, Estimate, Why
from .fixed_steps import rms, size_of
from .frames import Schedule
from .recording import Solution


def compared(runs: Attempts, asked: float, frames: Schedule) -> Controlled:
    """The run of the method whose error is at most `asked` [m], rms, or the best one found."""
    method = _method(runs, asked, frames)
    setting, better = method.first, _Better(runs, SMALL**2 * asked)
    best, error, size = None, Estimate.unknown(""), size_of(runs.scene)
    best_setting, stalls = setting, 0
    for number in range(RUNS):
        try:
            run = method.run(setting)
            if best is None:
                best = run
            if contact := better.contact(run):
                return runs.close(run, Estimate.unknown(contact))
            found = better.error_of(run)
            if found.rms >= error.rms / 2 and better.tightened(asked / found.rms):
                found = better.error_of(run)
        except UnstableError:
            if setting <= method.least or number == RUNS - 1:
                if best is None:
                    raise
                return runs.close(best, error.because(Why.UNSTABLE))
            setting = max(setting / 2, method.least)
            continue
        stalls = stalls + 1 if found.rms > error.rms / 2 else 0
        tiny, lost = found.rms < ROUNDING * size, found.rms > SMALL**2 * size
        # A phase that is lost takes more than one smaller setting to come back. It does come back
        # where better runs agree.
        known = lost and better.agreement <= SMALL * found.rms
        fewest, fall = (1, SMALL) if tiny else (2, SMALL**3)
        hopeless = stalls >= fewest and (setting / best_setting) ** method.order <= fall
        if not found.rms >= error.rms:
            best, error, best_setting = run, found, setting
        if found.rms <= asked:
            return runs.close(run, found)
        if hopeless and not known:
            return runs.close(best, error.because(Why.LEAST))
        if setting <= method.least:
            return runs.close(best, error.because(Why.NO_FINER))
        # The order predicts an error only where the phase of the motion is not lost.
        wanted = max((asked / (MARGIN * found.rms)) ** (1 / method.order), SMALL if lost else SMALL**4)
        finer = max(setting * min(wanted, 1 - SMALL), method.least)
        if stalls >= 2 and not known and runs.spent + run.evaluations * setting / finer > better.most:
            return runs.close(best, error.because(Why.LEAST))
        setting = finer
    assert best is not None
    return runs.close(best, error.because(Why.NOT_REACHED))


def estimated(runs: Attempts, run: Solution) -> Controlled:
    """The error of a run that is done."""
    runs.add(run)
    better = _Better(runs, SMALL**6 * size_of(runs.scene))
    if contact := better.contact(run):
        return runs.close(run, Estimate.unknown(contact))
    return runs.close(run, better.error_of(run))


class _Better:
    """The better run, which others are compared with."""

    def __init__(self, runs: Attempts, tolerance: float) -> None:
        self._runs, self._tolerance = runs, tolerance
        self._run: Solution | None = None
        self._looser: Solution | None = None
        self._best = runs.options.replace(integrator="dop853", precision="double", backend="cpu")
        self._smallest = runs.smallest(self._best)

    @property
    def run(self) -> Solution:
        if self._run is None:
            self._run = self._runs.adaptive(self._tolerance, options=self._best)
        return self._run

    @property
    def agreement(self) -> float:
        """The distance of the better run from the one before it [m], rms; infinite without one."""
        return rms(self.run.x[-1] - self._looser.x[-1]) if self._looser else math.inf

    @property
    def most(self) -> float:
        """Force evaluations that are affordable where errors do not fall."""
        left = self._tolerance / self._smallest
        return float(MOST * self.run.evaluations * left ** (1 / ORDER))

    def contact(self, run: Solution) -> str:
        """Why a sphere that responded in one of the two runs leaves no estimate; "" without contact."""
        if run.contacts:
            return Why.CONTACT
        return Why.MISSED if self.run.contacts else ""

    def error_of(self, run: Solution) -> Estimate:
        """The distance from a better run whose own error does not matter."""
        while True:
            error = Estimate.of(run.x[-1], self.run.x[-1], MARGIN)
            own = max(self._growth(), 1.0) * self.run.grid.local_error
            part = SMALL * error.rms / max(own, 1e-300)
            rounded = error.rms <= self._smallest
            if part >= 1 or rounded or not self._tighten(part):
                return error

    def tightened(self, part: float) -> bool:
        """Compute a better run yet, if there is one: the error that was found may be its own."""
        return self._tighten(min(part, 1.0))

    def _growth(self) -> float:
        """Error of the looser of two better runs over the sum of its local errors; 1 if there is one run."""
        if self._looser is None:
            return 1.0
        return self.agreement / max(self._looser.grid.local_error, 1e-300)

    def _tighten(self, part: float) -> bool:
        """Go on at a smaller tolerance, well below this part of the present one; False at the end."""
        if self._tolerance <= self._smallest:
            return False
        self._tolerance = max(SMALL * part * self._tolerance, self._smallest)
        self._looser, self._run = self._run, None
        return True


@dataclass
class _Method:
    """Runs of a method at a setting, a time step [s] or a tolerance of a step [m]."""

    first: float
    least: float
    order: float  # of the error in the setting
    run: Callable[[float], Solution]


def _method(runs: Attempts, asked: float, frames: Schedule) -> _Method:
    integrator = integrators()[runs.options.integrator]
    if integrator.adaptive:
        smallest = runs.smallest(runs.options)
        first = max(asked, smallest)
        return _Method(first, smallest, 1.0, lambda setting: runs.adaptive(setting, frames))
    order = integrator.order_of(runs.scene)
    first = runs.longest_dt(integrator.name)
    least = min(runs.duration / MANY_STEPS, first / 4)
    return _Method(first, least, order, lambda setting: runs.fixed(setting, frames))
