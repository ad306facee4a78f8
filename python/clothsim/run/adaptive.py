"""Error control: from the error that is asked for to a run that has it, and the estimate of it.

The request is for the rms error over the mass points at the end of the run: ``atol + rtol * size``.
The size is the longer side of the cloth.

The estimate is the distance of the run from a better run of the same scene, which starts from
positions that differ by rounding. So the estimate holds what rounding adds.

**dop853 in double** ("auto" takes it): global extrapolation on refined grids (Shampine, Watts:
Global error estimation for ordinary differential equations, ACM TOMS 2 (1976) 172). The first run
chooses its steps by a tolerance in proportion to what is asked. The second run takes the same grid,
refined by `_REFINEMENT`. The order is p = 8; let m = (steps of the first / steps of the second)^p.
The difference d of both is then 1 - m times the error of the first run. If that is small enough,
the first run is returned. Where tolerance proportionality holds, the error of the second run is m /
(1 - m) d. Each run sums the method's own estimates of its steps' errors. Proportionality holds if
the sums of both are as m to 1. If that is small enough, the second run is returned. Else the next
refinement has as many steps as the errors so far ask for. Refinement ends at the
grid of the smallest tolerance, and where errors fall no more. It also ends before it would cost more
than `_MOST` runs at the smallest tolerance.

**Other methods**: the better run is one of dop853. Its tolerance is tightened until the sum of its
local errors is at most `_SMALL` times the distance. The first run of the method tells how many steps
the error asks for.

After a contact no error can be told. Then the difference of two runs shows how far outcomes agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..engine.bound import guaranteed_dt
from ..engine.integration import integrators
from ..engine.state import MANY_STEPS
from ..errors import UnstableError
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .estimate import CONTACT, Controlled, Estimate
from .fixed_steps import Options, Solution, integrate, run_fixed, size_of
from .frames import NEGLIGIBLE, Schedule
from .recording import Recording, Watch

# Each constant is a ratio, found on the scenes of `benchmarks/error_control.py --stream tune`.
# docs/dev/error-control.md has the effect of half and twice of each.

# Tolerance of a step over the error that is asked for.
_TOLERANCE = 1.5
# Steps of a run above which its tolerance falls with their square: an error of frequency moves
# positions apart with the square of time.
_STEPS_OF_GROWTH = 60.0
# Part of the run that tells how many steps there will be.
_PILOT = 0.05
# Steps of a run over those of the run before it, at least.
_REFINEMENT = 1.25
# Estimates are taken times this, and proportional is what differs by less.
_MARGIN = 1.4
# What is this part of an error does not matter beside it: the local errors of a better run.
_SMALL = 0.1
# Runs of one method at most.
_RUNS = 8
# The smallest tolerance of a step, over the size: some fifty roundings of a position in double. Single
# precision keeps what a step adds with fewer digits, and compensates the sum.
_SMALLEST = {"double": 1e-14, "single": 1e-8}
# Below this error over the size, rounding may be a part of a difference, and does not fall with m.
_ROUNDING = 1e-9

_ORDER = 8  # of dop853

_LEAST = "runs with more steps come no closer to each other: rounding, magnified by the motion"
_UNSTABLE = "runs with more steps are unstable"
_NOT_REACHED = f"{_RUNS} runs did not reach the error that was asked for"
_NO_FINER = f"neither the smallest tolerance of a step nor {MANY_STEPS:,} steps reach the error that was asked for"
# A promise, not a setting: force evaluations of everything over those of a run at the smallest tolerance.
_MOST = 3.0


class _Exhausted(Exception):
    """The force evaluations that are left do not suffice; `run` is what they were enough for."""

    def __init__(self, run: Solution) -> None:
        self.run = run


class _Runs:
    """The runs of one call: what they cost, and how many force evaluations are left."""

    def __init__(self, scene: Scene, duration: float, options: Options, watch: Watch, most: float) -> None:
        self.scene, self.duration, self.options = scene, duration, options
        self._watch, self._most = watch, most
        self._done: list[Solution] = []
        self._finished: Recording | None = None

    def adaptive(
        self,
        tolerance: float,
        frames: Schedule | None = None,
        given: list[float] | None = None,
        rounded: bool = False,
        options: Options | None = None,
    ) -> Solution:
        """A run with error control; without frames no callback follows it.

        If it runs away at the tolerance, because stiff motion is let grow up to it, it is done
        again at a smaller one.
        """
        options = options or self.options
        smallest = self.smallest(options)
        tolerance = max(tolerance, smallest)
        while True:
            try:
                return self._add(
                    integrate(
                        self.scene,
                        self.duration,
                        tolerance,
                        options,
                        frames,
                        None if frames is None else self._watch,
                        given=given,
                        most=self._left,
                        rounded=rounded,
                    )
                )
            except UnstableError:
                if given is not None or tolerance <= smallest:
                    raise
            tolerance = max(_SMALL**3 * tolerance, smallest)

    def smallest(self, options: Options) -> float:
        """The smallest tolerance of a step [m]."""
        return _SMALLEST[options.precision] * size_of(self.scene)

    def steps_ahead(self, tolerance: float) -> float:
        """Steps of a run with error control, from the first part of it."""
        watch = Watch()
        try:
            run = integrate(
                self.scene,
                _PILOT * self.duration,
                max(tolerance, self.smallest(self.options)),
                self.options,
                watch=watch,
                most=self._left,
            )
        except UnstableError:
            return 0.0
        except KeyboardInterrupt:
            self._watch.recording = watch.recording
            raise
        self._done.append(run)
        return run.steps / _PILOT

    def fixed(self, dt: float, frames: Schedule, cost: int) -> Solution:
        """A run at a time step that is not the caller's; each step takes `cost` evaluations."""
        steps = math.ceil(self.duration / dt)
        dt = self.duration / steps
        enough = self._left >= steps * cost
        duration = self.duration if enough else max(1, int(self._left / cost)) * dt
        watch = self._watch if enough or not self._finished else None
        return self._add(run_fixed(self.scene, duration, dt, self.options, frames, watch, own_step=True))

    def add(self, run: Solution) -> None:
        self._done.append(run)

    @property
    def spent(self) -> int:
        """Force evaluations of the runs so far."""
        return sum(run.evaluations for run in self._done)

    @property
    def _left(self) -> float:
        return self._most - self.spent

    def _add(self, run: Solution) -> Solution:
        self._done.append(run)
        if run.t[-1] < self.options.start + self.duration * (1 - NEGLIGIBLE):
            raise _Exhausted(run)
        self._finished = self._watch.recording
        return run

    def hand_over(self) -> None:
        """Let the last run that came to its end be what is handed over."""
        if self._finished is not None:
            self._watch.recording = self._finished

    def close(self, solution: Solution, error: Estimate, companion: Solution | None = None) -> Controlled:
        others = [run for run in self._done if run is not solution]
        return Controlled(
            solution, error, companion, sum(run.evaluations for run in others), sum(run.wall_time for run in others)
        )

    def exhausted(self) -> str:
        return f"max_evaluations = {self._most:g} does not suffice"


def solve(
    scene: Scene, duration: float, asked: float, options: Options, frames: Schedule, watch: Watch, most: float = math.inf
) -> Controlled:
    """The run whose error is at most `asked` [m], rms, or the best one found."""
    runs = _Runs(scene, duration, options, watch, most)
    by_grids = options.integrator == "dop853" and options.precision == "double"
    try:
        return (_refined if by_grids else _compared)(runs, asked, frames)
    except _Exhausted as exhausted:
        return runs.close(exhausted.run, Estimate.unknown(runs.exhausted()))
    except KeyboardInterrupt:
        runs.hand_over()
        raise


def _refined(runs: _Runs, asked: float, frames: Schedule) -> Controlled:
    size, start = size_of(runs.scene), runs.options.start
    tolerance = _TOLERANCE * asked
    tolerance /= 1 + (runs.steps_ahead(tolerance) / _STEPS_OF_GROWTH) ** 2
    before = first = runs.adaptive(tolerance, frames)
    best, error = first, Estimate.unknown(runs.exhausted())
    ratio, least = _REFINEMENT, math.inf
    # As many steps as the smallest tolerance makes.
    finest = max(tolerance / runs.smallest(runs.options), 1.0) ** (1 / _ORDER) * _REFINEMENT
    most = _MOST * first.evaluations * finest / _REFINEMENT
    for number in range(1, _RUNS):
        if runs.spent + ratio * first.evaluations > most:
            return runs.close(best, error.because(_LEAST))
        given = first.grid.refined(start, ratio)
        try:
            after = runs.adaptive(tolerance, frames, given, rounded=bool(number % 2))
        except _Exhausted:
            return runs.close(best, error.because(runs.exhausted()))
        except UnstableError:
            if ratio >= finest or number == _RUNS - 1:
                return runs.close(best, error.because(_UNSTABLE))
            ratio = min(ratio * _REFINEMENT, finest)
            continue
        if before.contacts or after.contacts:
            return runs.close(before, Estimate.unknown(CONTACT), after)
        pair = _Pair(before, after)
        if pair.before.rms <= asked:
            return runs.close(before, pair.before)
        extrapolates = pair.proportional and asked >= _ROUNDING * size
        if extrapolates and pair.after.rms <= asked:
            return runs.close(after, pair.after)
        stalled = pair.before.rms > least / 2
        hopeless = stalled and (before.steps / best.steps) ** _ORDER >= _SMALL**-3
        if pair.before.rms < least:
            best, error, least = before, pair.before, pair.before.rms
        if ratio >= finest or hopeless:
            return runs.close(best, error.because(_LEAST))
        wanted = pair.after.rms if pair.proportional else pair.before.rms / 2
        order = _ORDER if pair.proportional or number == 1 else _ORDER / 2
        least_ratio = _SMALL ** (-2 / _ORDER) if stalled else _REFINEMENT
        ratio = min(ratio * min(max((wanted / asked) ** (1 / order), least_ratio), 3.0), finest)
        before = after
    return runs.close(best, error.because(_NOT_REACHED))


class _Pair:
    """Two runs, the second one on a finer grid: the errors of both."""

    def __init__(self, before: Solution, after: Solution) -> None:
        difference = after.x[-1] - before.x[-1]
        m = min((before.steps / after.steps) ** _ORDER, 0.9)
        found = after.grid.local_error / max(before.grid.local_error, 1e-300)
        self.proportional = 1 / _MARGIN <= found / m <= _MARGIN
        self.before = Estimate.of(difference, _MARGIN / (1 - m))
        m = min(max(found, m), 0.9)
        self.after = Estimate.of(difference, _MARGIN * m / (1 - m))


def _compared(runs: _Runs, asked: float, frames: Schedule) -> Controlled:
    method = _method(runs, asked, frames)
    setting, better = method.first, _Better(runs, _SMALL**2 * asked)
    best, error, size = None, Estimate.unknown(runs.exhausted()), size_of(runs.scene)
    best_setting, stalls = setting, 0
    for number in range(_RUNS):
        try:
            run = method.run(setting)
            if best is None:
                best = run
            if better.met(run):
                return runs.close(run, Estimate.unknown(CONTACT), better.run)
            found = better.error_of(run)
            if found.rms >= error.rms / 2 and better.tightened(asked / found.rms):
                found = better.error_of(run)
        except _Exhausted as exhausted:
            return runs.close(best or exhausted.run, error.because(runs.exhausted()))
        except UnstableError:
            if setting <= method.least or number == _RUNS - 1:
                if best is None:
                    raise
                return runs.close(best, error.because(_UNSTABLE))
            setting = max(setting / 2, method.least)
            continue
        stalls = stalls + 1 if found.rms > error.rms / 2 else 0
        tiny, lost = found.rms < _ROUNDING * size, found.rms > _SMALL**2 * size
        # A phase that is lost takes more than one smaller setting to come back.
        hopeless = stalls >= (1 if tiny else 2) and (best_setting / setting) ** method.order >= _SMALL**-3
        if not found.rms >= error.rms:
            best, error, best_setting = run, found, setting
        if found.rms <= asked:
            return runs.close(run, found)
        if hopeless:
            return runs.close(best, error.because(_LEAST))
        if setting <= method.least:
            return runs.close(best, error.because(_NO_FINER))
        # The order tells what to expect only where the phase of the motion is not lost.
        wanted = max((asked / (_MARGIN * found.rms)) ** (1 / method.order), _SMALL if lost else 1e-4)
        finer = max(setting * min(wanted, 0.9), method.least)
        if stalls >= 2 and runs.spent + run.evaluations * setting / finer > better.most:
            return runs.close(best, error.because(_LEAST))
        setting = finer
    assert best is not None
    return runs.close(best, error.because(_NOT_REACHED))


def estimate_of(scene: Scene, duration: float, run: Solution) -> Controlled:
    """The error of a run that is done."""
    runs = _Runs(scene, duration, run.options, Watch(), math.inf)
    runs.add(run)
    better = _Better(runs, _SMALL**6 * size_of(scene))
    if better.met(run):
        return runs.close(run, Estimate.unknown(CONTACT), better.run)
    return runs.close(run, better.error_of(run))


class _Better:
    """The better run, which others are compared with."""

    def __init__(self, runs: _Runs, tolerance: float) -> None:
        self._runs, self._tolerance = runs, tolerance
        self._run: Solution | None = None
        self._best = runs.options.replace(integrator="dop853", precision="double", backend="cpu")
        self._smallest = runs.smallest(self._best)

    @property
    def run(self) -> Solution:
        if self._run is None:
            self._run = self._runs.adaptive(self._tolerance, rounded=True, options=self._best)
        return self._run

    @property
    def most(self) -> float:
        """Force evaluations that are worth while where errors do not fall."""
        left = self._tolerance / self._smallest
        return float(_MOST * self.run.evaluations * left ** (1 / _ORDER))

    def met(self, run: Solution) -> bool:
        """Whether a sphere responded in one of the two runs."""
        return bool(run.contacts or self.run.contacts)

    def error_of(self, run: Solution) -> Estimate:
        """The distance from a better run whose own local errors do not matter."""
        while True:
            error = Estimate.of(run.x[-1] - self.run.x[-1], _MARGIN)
            part = _SMALL * error.rms / max(self.run.grid.local_error, 1e-300)
            rounded = error.rms <= self._smallest
            if part >= 1 or rounded or not self._tighten(part):
                return error

    def tightened(self, part: float) -> bool:
        """Compute a better run yet, if there is one: the error that was found may be its own."""
        return self._tighten(min(part, 1.0))

    def _tighten(self, part: float) -> bool:
        """Go on at a smaller tolerance, well below this part of the present one; False at the end."""
        if self._tolerance <= self._smallest:
            return False
        self._tolerance = max(_SMALL * part * self._tolerance, self._smallest)
        self._run = None
        return True


@dataclass
class _Method:
    """Runs of a method at a setting, a time step [s] or a tolerance of a step [m]."""

    first: float
    least: float
    order: float  # of the error in the setting
    run: Callable[[float], Solution]


def _method(runs: _Runs, asked: float, frames: Schedule) -> _Method:
    integrator = integrators()[runs.options.integrator]
    if integrator.adaptive:
        smallest = runs.smallest(runs.options)
        first = max(_TOLERANCE * asked, smallest)
        return _Method(first, smallest, 1.0, lambda setting: runs.adaptive(setting, frames))
    cloth = core_cloth(runs.scene)
    order = integrator.order_of(runs.scene)
    cost = integrator.evaluations_per_step(runs.scene.cloth.damped)
    first = min(guaranteed_dt(cloth, runs.options.integrator), runs.duration / 4)
    least = min(runs.duration / MANY_STEPS, first / 4)
    return _Method(first, least, order, lambda setting: runs.fixed(setting, frames, cost))
