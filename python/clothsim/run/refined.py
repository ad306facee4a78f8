"""Error control of dop853 in double: global extrapolation on refined grids, then by tolerances.

**Refined grids** (Shampine, Watts: Global error estimation for ordinary differential equations, ACM
TOMS 2 (1976) 172). The first run chooses its steps by a tolerance in proportion to what is asked.
The second run takes the same grid, refined by `REFINEMENT`. The order is p = 8; let m = (steps of
the first / steps of the second)^p. The difference d of both is then 1 - m times the error of the
first run. If that is small enough, the first run is returned. Where errors are proportional, the
error of the second run is m / (1 - m) d. Each run sums the method's own estimates of its steps'
errors. Errors are proportional if the sums of both are as m to 1. If m is no less than `SMALL`, the
steps are no fewer than `FEW`, and the error is small enough, the second run is returned. Else the
next refinement has as many steps as the errors so far ask for.

**Tolerances** (Stetter: Considerations concerning a theory for ODE-solvers, 1978). Errors are not
proportional where springs collapse at a moment that the grid does not resolve. From then on each
run chooses its own steps, by a tolerance in proportion to the errors so far. Its distance from the
next run, at a tolerance `SMALL`^2 times as large, is its error.

Refinement ends at the grid of the smallest tolerance, and where errors fall no more. It also ends
before it would cost more than `MOST` runs at the smallest tolerance.
"""

from __future__ import annotations

import math
from contextlib import suppress

from ..errors import UnstableError
from ..model.as_core import core_cloth
from .attempts import MARGIN, MOST, ORDER, ROUNDING, RUNS, SMALL, Attempts, Controlled, Estimate, Why
from .fixed_steps import RunOptions, size_of
from .frames import Schedule
from .recording import Solution

# As the constants of `attempts`, these are ratios, found in the same way.
# Tolerance of a step of a short run over the error that is asked for.
TOLERANCE = 1.5
# Radians, approximately, of the fastest motion above which tolerances fall with their cube. Each step adds an error, and an
# error of frequency moves positions apart with the square of time.
GROWTH = 12.0
# Steps of a run over those of the run before it, at least.
REFINEMENT = 1.25
# Steps below which no error is extrapolated: the sum of few local errors is a poor estimate.
FEW = 60
# Part of the local errors that a refinement leaves, at most and at least.
_FALL = REFINEMENT**-ORDER
_LEAST_FALL = SMALL**4


def refined(runs: Attempts, asked: float, frames: Schedule, plain: RunOptions | None = None) -> Controlled:
    """The run of dop853 whose error is at most `asked` [m], rms, or the best one found.

    `plain`: options of a fixed step that will do as well, at the longest that is stable. That costs less than a finer run.
    """
    before = first = runs.adaptive(_first_tolerance(runs, asked), frames)
    if first.contacts:
        return runs.close(first, Estimate.unknown(Why.CONTACT))
    if plain is not None:
        with suppress(UnstableError):
            run = runs.fixed(runs.longest_dt(plain.integrator), frames, plain)
            error = Estimate.of(run.x[-1], first.x[-1], MARGIN)
            if error.rms <= asked and not run.contacts:
                return runs.close(run, error)
    best, error, least = first, Estimate.unknown(""), math.inf
    finer = _Finer(runs, first, frames)
    most = MOST * finer.evaluations_of_finest
    for number in range(1, RUNS):
        if runs.spent + finer.evaluations > most:
            return runs.close(best, error.because(Why.LEAST))
        try:
            after = finer.run()
        except UnstableError:
            if finer.is_finest or number == RUNS - 1:
                return runs.close(best, error.because(Why.UNSTABLE))
            finer.refine(finer.fall * _FALL)
            continue
        if after.contacts:
            return runs.close(after, Estimate.unknown(Why.CONTACT))
        pair = _Pair(before, after, finer.by_grid)
        if pair.before.rms <= asked:
            return runs.close(before, pair.before)
        if pair.extrapolates and pair.after.rms <= asked and asked >= ROUNDING * size_of(runs.scene):
            return runs.close(after, pair.after)
        stalled = pair.before.rms > least / 2
        hopeless = stalled and before.grid.local_error <= SMALL**3 * best.grid.local_error
        if pair.before.rms < least:
            best, error, least = before, pair.before, pair.before.rms
        elif stalled:
            # The least of several distances may be small by chance.
            error = max(error, Estimate.of(best.x[-1], after.x[-1], MARGIN), key=lambda one: one.rms)
        if finer.is_finest or hopeless:
            return runs.close(best, error.because(Why.LEAST))
        finer.choose(pair, asked, SMALL**2 if stalled else _FALL)
        before = after
    return runs.close(best, error.because(Why.NOT_REACHED))


def _first_tolerance(runs: Attempts, asked: float) -> float:
    """The tolerance of a step whose run should have about the error that is asked for [m].

    The number of steps times tolerance^(1/p) measures how far the motion goes, at any tolerance. Errors
    of damped motion are forgotten.
    """
    tolerance = TOLERANCE * asked
    _, damping = core_cloth(runs.scene.cloth).mode_bounds
    motion = runs.steps_ahead(tolerance) * (tolerance / size_of(runs.scene)) ** (1 / ORDER)
    kept = 1 + damping * runs.duration / 2
    return float(tolerance / (1 + (motion / kept / GROWTH) ** 3))


class _Pair:
    """Two runs, the second one with smaller local errors: the errors of both."""

    def __init__(self, before: Solution, after: Solution, by_grid: bool) -> None:
        x, better = before.x[-1], after.x[-1]
        self.left = before.grid.local_error, after.grid.local_error
        found = self.left[1] / max(self.left[0], 1e-300)
        m = min((before.steps / after.steps) ** ORDER if by_grid else found, 1 - SMALL)
        self.proportional = by_grid and 1 / MARGIN <= found / m <= MARGIN
        self.extrapolates = self.proportional and m >= SMALL and after.steps >= FEW
        self.before = Estimate.of(x, better, MARGIN / (1 - m))
        m = min(max(found, m), 1 - SMALL)
        self.after = Estimate.of(x, better, MARGIN * m / (1 - m))


class _Finer:
    """The next run: on the grid of the first run, refined, or by a tolerance."""

    def __init__(self, runs: Attempts, first: Solution, frames: Schedule) -> None:
        self._runs, self._first, self._frames = runs, first, frames
        self._smallest = runs.smallest(runs.options) / first.grid.tolerance
        self.by_grid = True
        self.fall = _FALL  # local errors of the run over those of the first

    @property
    def evaluations(self) -> float:
        """Force evaluations that the run should take."""
        return float(self._first.evaluations * self.fall ** (-1 / ORDER))

    @property
    def evaluations_of_finest(self) -> float:
        """Force evaluations of a run at the smallest tolerance."""
        return float(self._first.evaluations * self._smallest ** (-1 / ORDER))

    @property
    def _finest(self) -> float:
        return self._smallest * (_FALL if self.by_grid else 1.0)

    @property
    def is_finest(self) -> bool:
        """Whether no run is finer."""
        return self.fall <= self._finest

    def run(self) -> Solution:
        grid = self._first.grid
        if not self.by_grid:
            return self._runs.adaptive(self.fall * grid.tolerance, self._frames)
        given = grid.refined(self._runs.options.start, self.fall ** (-1 / ORDER))
        return self._runs.adaptive(grid.tolerance, self._frames, given)

    def refine(self, fall: float) -> None:
        self.fall = max(fall, self.fall * _LEAST_FALL, self._finest)

    def choose(self, pair: _Pair, asked: float, least: float) -> None:
        """Choose the run that should have the error asked for; local errors fall by `least` at least."""
        if pair.proportional:
            self.refine(self.fall * min(asked / pair.after.rms, least))
            return
        self.by_grid = False
        before, after = (error / self._first.grid.local_error for error in pair.left)
        self.refine(min(min(after, 1.0) * min(SMALL**2, least), before * asked / pair.before.rms))
