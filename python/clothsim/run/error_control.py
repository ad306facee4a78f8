"""Error control: a search for a run that has the error asked for, and the estimate of this error.

The request is for the rms error over the mass points at the end of the run: ``atol + rtol * size``.
The size is the longer side of the cloth.

The estimate is the distance of the run from a better run of the same scene. The better run takes
other steps and rounds differently, so the distance includes rounding errors.

A search is a generator: it yields a `Job`, is sent its `Trajectory`, and returns the trajectory to
hand over and its error. `search_by_refinement` searches with dop853 in double and with rkc2, which
"auto" takes; for undamped cloths `search_by_halving` comes before it. `search_by_comparison` serves
all other methods. After a response that is no force no error is estimated. A search makes `RUNS`
runs at most; docs/dev/error-control.md says why each run ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .. import _core
from ..base import Floats
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt_or_error
from ..methods.integrators import METHODS
from ..model.scene import Scene, turning_times
from .frames import Frames
from .reasons import Reason
from .recording import Recording, Watch
from .trajectory import Job, Trajectory

MANY_STEPS = 1_000_000  # most steps with which a fixed-step method tries to reach a tolerance

# Each constant is a ratio that was found on the scenes of `benchmarks/error_control.py --stream
# tune`. docs/dev/error-control.md has the effect of half and twice of each.

PILOT = 0.05  # part of the run from which the number of steps is estimated
# Estimates are multiplied by this, and errors that differ by less count as proportional.
MARGIN = 1.4
# Local errors of a better run are neglected below this part of an error.
SMALL = 0.1
RUNS = 8  # most runs of one method
# The smallest tolerance of a step, over the size, is some fifty roundings of a position in double.
# Single precision keeps fewer digits of what a step adds, and compensates the sum.
SMALLEST = {"double": 1e-14, "single": 1e-8}
# Runs whose distance does not fall with their local errors count as parted from this part of the
# size on. Rounding leaves a hundredth of it in most motions.
PARTING = 1e-7
# Below this error over the size, rounding may be a part of a difference, and does not fall with m.
ROUNDING = 1e-9
TOLERANCE = 1.5  # tolerance of a step of a short run over the error that is asked for
# Tolerances fall with the cube of the motion from about so many radians of the fastest mode on:
# each step adds an error, and an error of frequency moves positions apart with the square of time.
GROWTH = 12.0
REFINEMENT = {"dop853": 1.25, "rkc2": 1.5}  # steps of the second run over those of the first
# Errors of runs with fewer steps are not extrapolated: the sum of few local errors is a poor
# estimate.
LEAST_STEPS = 60

ORDER = METHODS["dop853"].order
# Errors fall by this order at least with more steps in contact, and in wind: a triangle that turns
# through the wind has all but a kink in its force.
ORDER_OF_KINKS = 2
# A call evaluates forces at most so many times as often as a run at the smallest tolerance. This is
# a promise, not a setting.
MOST_COST = 3.0
# Evaluations of a step of rkc2 grow with the root of its length.
_POWER_OF_STEPS = {"dop853": 1.0, "rkc2": 0.5}
_FALL = REFINEMENT["dop853"] ** -ORDER  # largest part of local errors that a refinement leaves
_LEAST_FALL = SMALL**4  # smallest part of local errors that a refinement leaves

LOOSE = 1e-6  # smallest error over the size for which fixed steps of Verlet are tried
HALVINGS = 2  # most halvings of these steps
# Errors of Verlet fall by these factors with half the step. Two runs do not show the factor, and it
# is assumed. Three runs show it; where it is below the least, they do not resolve the motion.
ASSUMED_FALL = 3.0
LEAST_FALL = 2.0
MOST_FALL = 4.0


def longer_side(scene: Scene) -> float:
    """Return the longer side of the cloth [m], to which a relative tolerance refers."""
    return max(scene.cloth.size)


def rms_distance(difference: Floats) -> float:
    """Return the root of the mean squared distance over the mass points."""
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


class Estimate(NamedTuple):
    """An error of the last positions [m], over the mass points; NaN if it is unknown.

    `reason`: why it is unknown, or why it is larger than what was asked for.
    """

    max: float = math.nan
    rms: float = math.nan
    reason: str = ""

    @classmethod
    def from_better_positions(cls, x: Floats, better: Floats, factor: float) -> Estimate:
        """Return `factor` times the distance from better positions, as an error.

        Half a unit in the last place is added: equal positions are rounded too.
        """
        distances = factor * np.linalg.norm(x - better, axis=-1) + np.spacing(np.abs(x).max()) / 2
        return cls(float(distances.max()), float(np.sqrt((distances**2).mean())))


class ControlledRun(NamedTuple):
    """A trajectory, its error, and force evaluations of the runs that are not returned."""

    trajectory: Trajectory
    error: Estimate
    evaluations: int


FAILURES = (UnstableError, ContactError)  # how a fixed step that is too long ends a run

Search = Generator[Job, Trajectory, tuple[Trajectory, Estimate]]
Attempt = Generator[Job, Trajectory, Trajectory]  # part of a search that ends with a run


def run_to_error(job: Job, request: float, watch: Watch, auto: bool = False) -> ControlledRun:
    """Search for a run whose rms error is at most `request` [m], and return it or the best run.

    `auto`: the method is not the caller's, and Verlet is tried first where it may cost less.
    """
    # This refuses too many kinks before the first run.
    turning_times(job.scene, job.start, job.start + job.duration)
    runs: list[Trajectory] = []
    if job.options.integrator in _POWER_OF_STEPS and job.options.precision == "double":
        search = search_by_refinement(job, request, runs)
        if auto and request >= LOOSE * longer_side(job.scene) and _is_conservative(job):
            search = search_by_halving(job, request, search)
        return _conduct_search(search, runs, watch)
    return _conduct_search(search_by_comparison(job, request, runs), runs, watch)


def estimate_error_of_run(job: Job, run: Trajectory) -> ControlledRun:
    """Estimate the error of a run."""
    return _conduct_search(_search_estimate(job, run), [run], Watch())


def _conduct_search(search: Search, runs: list[Trajectory], watch: Watch) -> ControlledRun:
    """Make the runs of a search, and add them to `runs`, until it ends."""
    recording = watch.recording
    last_complete = recording  # recording of the last run that came to its end
    past_kinds: set[str] = set()  # of warnings, each of which a search gives once
    proceed: Callable[[Any], Job] = search.send
    answer: Any = None
    try:
        while True:
            try:
                job = proceed(answer)
            except StopIteration as end:
                best, error = end.value
                break
            watch_of_run = watch if job.shown else Watch()
            recording = Recording(job, watch_of_run, quiet=frozenset(past_kinds))
            try:
                answer = recording.run_to_end().trajectory()
                runs.append(answer)
                proceed = search.send
                last_complete = watch.recording
            except UnstableError as failure:
                proceed = search.throw
                answer = failure
            except ContactError as failure:
                if job.dt is None:
                    raise  # Steps meet their tolerance, so the solution itself goes through.
                proceed = search.throw
                answer = failure
            past_kinds |= recording.state.judge.past_kinds
    except KeyboardInterrupt:
        # The last run that came to its end is handed over.
        watch.recording = last_complete or watch.recording or recording
        raise
    return ControlledRun(best, error, sum(run.evaluations for run in runs if run is not best))


def _sum_of_evaluations(runs: list[Trajectory]) -> int:
    return sum(run.evaluations for run in runs)


def _smallest_tolerance(job: Job) -> float:
    """Return the smallest tolerance of a step [m]."""
    return SMALLEST[job.options.precision] * longer_side(job.scene)


def _without_frames(job: Job, **changes: object) -> Job:
    """Return a job without frames, for a run that is not returned."""
    return replace(job, shown=False, frames=Frames(), **changes)  # type: ignore[arg-type]


def _run_at_tolerance(job: Job, tolerance: float) -> Attempt:
    """Run at a tolerance of a step [m].

    If the tolerance lets stiff motion grow until the run is unstable, it is repeated at a smaller
    tolerance.
    """
    smallest = _smallest_tolerance(job)
    tolerance = max(tolerance, smallest)
    while True:
        try:
            return (yield replace(job, tolerance=tolerance))
        except UnstableError:
            if tolerance <= smallest:
                raise
        tolerance = max(SMALL**3 * tolerance, smallest)


def _longest_dt(job: Job, integrator: str) -> float:
    """Return the longest fixed step [s]: the guaranteed stable one, half of it with spheres."""
    stable = stable_dt_or_error(job.scene, integrator)
    return min(stable / 2 if job.scene.spheres else stable, job.duration / 4)


def _with_fixed_step(job: Job, dt: float) -> Job:
    """Return a job with equal steps of at most `dt`, which the caller did not choose."""
    longest = _longest_dt(job, job.options.integrator)
    step = job.duration / math.ceil(job.duration / dt)
    return replace(job, dt=step, own_step=True, longest=longest)


# Fixed steps are halved (Richardson). Where stability sets the step, the error at the longest
# stable step is often small enough, and Verlet evaluates forces once a step.


def _is_conservative(job: Job) -> bool:
    """Return whether springs and constant forces alone act, for which Verlet keeps its order."""
    scene = job.scene
    return not (scene.damped or scene.spheres or scene.cloth.driven or job.force)


def search_by_halving(job: Job, request: float, next_search: Search) -> Search:
    """Search with Verlet, from the longest stable step on, by halving it.

    If no run has an rms error of at most `request` [m], `next_search` follows.
    """
    verlet = replace(job, options=replace(job.options, integrator="velocity_verlet"))
    count = math.ceil(job.duration / _longest_dt(verlet, "velocity_verlet"))
    fall = ASSUMED_FALL
    last_distance = math.inf
    with suppress(*FAILURES):
        coarse = yield _without_frames(_with_fixed_step(verlet, job.duration / count))
        for k in range(1, HALVINGS + 1):
            fine = yield _with_fixed_step(verlet, job.duration / (2**k * count))
            distance = rms_distance(fine.x[-1] - coarse.x[-1])
            if last_distance < math.inf:
                fall = min(last_distance / max(distance, 1e-300), MOST_FALL)
            error = Estimate.from_better_positions(
                fine.x[-1], coarse.x[-1], MARGIN / (max(fall, LEAST_FALL) - 1)
            )
            if error.rms <= request and fall >= LEAST_FALL:
                return fine, error
            if fall < LEAST_FALL or error.rms > MOST_FALL * request:
                break
            coarse = fine
            last_distance = distance
    return (yield from next_search)


# Runs of dop853 and rkc2 in double refine the grid of the first run (Shampine, Watts: Global error
# estimation for ordinary differential equations, ACM TOMS 2 (1976) 172). They take smaller
# tolerances instead where errors are not proportional (Stetter: Considerations concerning a theory
# for ODE-solvers, 1978). docs/dev/error-control.md has the algorithm.


def search_by_refinement(job: Job, request: float, runs: list[Trajectory]) -> Search:
    """Search with dop853 or rkc2 for a run whose rms error is at most `request` [m]."""
    tolerance = yield from _first_tolerance(job, request)
    first = yield from _run_at_tolerance(job, tolerance)
    if first.has_contacts:
        return first, Estimate(reason=Reason.CONTACT)
    best = coarse = first
    error = Estimate()
    least = math.inf
    next_run = _NextRun(job, first)
    most = MOST_COST * next_run.evaluations_of_finest
    growth = 0.0  # largest distance of two runs over the local errors of the first one
    parting = Parting(longer_side(job.scene))

    def best_run_and_error(reason: str) -> tuple[Trajectory, Estimate]:
        return best, parting.judge_estimate(error._replace(reason=reason))

    for number in range(1, RUNS):
        if _sum_of_evaluations(runs) + next_run.expected_evaluations > most:
            return best_run_and_error(Reason.LEAST.format(most=MOST_COST))
        try:
            fine = yield from next_run.make_run()
        except UnstableError:
            if next_run.is_finest or number == RUNS - 1:
                return best_run_and_error(Reason.UNSTABLE)
            next_run.set_fall(next_run.fall * _FALL)
            continue
        if fine.has_contacts:
            return fine, Estimate(reason=Reason.CONTACT)
        if _have_same_steps(coarse, fine, next_run.refinement):
            # Runs that are alike say nothing about the error of either.
            if next_run.is_finest:
                return best_run_and_error(Reason.LEAST.format(most=MOST_COST))
            next_run.set_fall(next_run.fall * SMALL**2)
            continue
        comparison = _Comparison(coarse, fine, next_run.by_grid, growth)
        growth = max(growth, comparison.growth)
        parting.add_distance(coarse, comparison.distance)
        if comparison.coarse_error.rms <= request:
            return coarse, comparison.coarse_error
        may_extrapolate = comparison.extrapolates and request >= ROUNDING * longer_side(job.scene)
        if may_extrapolate and comparison.fine_error.rms <= request:
            return fine, comparison.fine_error
        stall = comparison.coarse_error.rms > least * max(0.5, MARGIN * next_run.first_fall)
        hopeless = stall and coarse.local_error <= SMALL**3 * best.local_error
        if comparison.coarse_error.rms < least:
            # The error of the finer run of two that are near is at most about their distance.
            best = fine
            error = comparison.coarse_error
            least = error.rms
        elif stall:
            # The least of several distances may be small by chance.
            distance = Estimate.from_better_positions(best.x[-1], fine.x[-1], MARGIN)
            error = max(error, distance, key=lambda estimate: estimate.rms)
        if next_run.is_finest or hopeless:
            return best_run_and_error(Reason.LEAST.format(most=MOST_COST))
        next_run.choose_fall(comparison, request, SMALL**2 if stall else _FALL)
        coarse = fine
    return best_run_and_error(Reason.NOT_REACHED.format(runs=RUNS))


def _have_same_steps(coarse: Trajectory, fine: Trajectory, refinement: float) -> bool:
    """Return whether two runs took all but the same steps.

    Tolerances do not set the steps where motions do.
    """
    return (
        fine.steps < (1 + refinement) / 2 * coarse.steps
        and fine.local_error > SMALL * coarse.local_error
    )


class Parting:
    """A test whether runs with smaller local errors approach each other."""

    def __init__(self, size: float) -> None:
        self._least = PARTING * size
        self._most = SMALL**2 * size
        self._pairs: list[tuple[float, float]] = []  # local error and distance of each pair of runs

    def add_distance(self, run: Trajectory, distance: float) -> None:
        self._pairs.append((run.local_error, distance))

    def judge_estimate(self, error: Estimate) -> Estimate:
        """Return the estimate, without a number where the runs tell nothing of each other.

        They do not where their distances did not fall, or are too large.
        """
        if not self._pairs or not error.rms > self._least:
            return error
        local_error, distance = self._pairs[-1]
        if distance > self._most or any(
            d <= distance and local_error <= e / 2 for e, d in self._pairs[:-1]
        ):
            return Estimate(reason=Reason.APART.format(distance=distance))
        return error


def _first_tolerance(job: Job, request: float) -> Generator[Job, Trajectory, float]:
    """Estimate the tolerance of a step [m] that gives a run about the error asked for.

    The number of steps times tolerance^(1/p) measures how far the motion goes, at any tolerance.
    Errors of damped motion are forgotten.
    """
    tolerance = TOLERANCE * request
    if job.options.integrator == "rkc2":  # Damped motion forgets its errors.
        return tolerance
    steps = 0.0
    with suppress(UnstableError):
        smallest = max(tolerance, _smallest_tolerance(job))
        pilot = _without_frames(job, duration=PILOT * job.duration, tolerance=smallest)
        steps = (yield pilot).steps / PILOT
    _, damping = _core.mode_bounds(job.scene.cloth.core, job.scene.core_forces)
    motion = steps * (tolerance / longer_side(job.scene)) ** (1 / ORDER)
    decay = 1 + damping * job.duration / 2
    return float(tolerance / (1 + (motion / decay / GROWTH) ** 3))


class _Comparison:
    """The errors of two runs, the second of which has smaller local errors."""

    def __init__(self, coarse: Trajectory, fine: Trajectory, by_grid: bool, growth: float) -> None:
        """Compare two runs.

        `growth` is that of errors in earlier comparisons. Runs that are closer than it lets expect
        may be so by chance.
        """
        x = coarse.x[-1]
        better = fine.x[-1]
        self.distance = rms_distance(x - better)
        self.growth = self.distance / max(coarse.local_error, 1e-300)
        chance = max(SMALL * growth / max(self.growth, 1e-300), 1.0)
        self.local_errors = coarse.local_error, fine.local_error
        ratio = fine.local_error / max(coarse.local_error, 1e-300)
        # A contact adds errors that fall more slowly than those of smooth motion.
        kinks = fine.watched["in_contact"] or fine.scene.wind is not None
        order = METHODS[fine.options.integrator].order
        if kinks:
            order = min(order, ORDER_OF_KINKS)
        m = min((coarse.steps / fine.steps) ** order if by_grid else ratio, 1 - SMALL)
        # Errors of rkc2 near its stable step fall faster than their order.
        least = 0.0 if fine.options.integrator == "rkc2" else 1 / MARGIN
        self.proportional = by_grid and least <= ratio / m <= MARGIN
        self.extrapolates = self.proportional and m >= SMALL and fine.steps >= LEAST_STEPS
        self.coarse_error = Estimate.from_better_positions(x, better, chance * MARGIN / (1 - m))
        m = min(max(ratio, m), 1 - SMALL)
        self.fine_error = Estimate.from_better_positions(x, better, chance * MARGIN * m / (1 - m))


class _NextRun:
    """The next run of a search, on a refined grid of the first run or by a tolerance."""

    def __init__(self, job: Job, first: Trajectory) -> None:
        self._job = job
        self._first = first
        self._smallest = _smallest_tolerance(job) / first.tolerance
        self._order = METHODS[job.options.integrator].order
        self.refinement = REFINEMENT[job.options.integrator]
        self.by_grid = True
        self.first_fall = self.refinement**-self._order
        self.fall = self.first_fall  # local errors of the run over those of the first
        self.evaluations_of_finest = self._expected_evaluations_at(self._smallest)

    @property
    def expected_evaluations(self) -> float:
        return self._expected_evaluations_at(self.fall)

    def _expected_evaluations_at(self, fall: float) -> float:
        power = _POWER_OF_STEPS[self._job.options.integrator] / self._order
        return float(self._first.evaluations * fall**-power)

    @property
    def _finest_fall(self) -> float:
        return self._smallest * (_FALL if self.by_grid else 1.0)

    @property
    def is_finest(self) -> bool:
        return self.fall <= self._finest_fall

    def make_run(self) -> Attempt:
        first = self._first
        if not self.by_grid:
            return (yield from _run_at_tolerance(self._job, self.fall * first.tolerance))
        grid = first.refined_step_ends(self.fall ** (-1 / self._order))
        return (yield replace(self._job, tolerance=first.tolerance, grid=grid))

    def set_fall(self, fall: float) -> None:
        self.fall = max(fall, self.fall * _LEAST_FALL, self._finest_fall)

    def choose_fall(self, comparison: _Comparison, request: float, least: float) -> None:
        """Choose the run to have the error asked for; local errors fall by `least` at least."""
        if comparison.proportional:
            self.set_fall(self.fall * min(request / comparison.fine_error.rms, least))
            return
        self.by_grid = False
        coarse, fine = (error / self._first.local_error for error in comparison.local_errors)
        to_request = coarse * request / comparison.coarse_error.rms
        self.set_fall(min(min(fine, 1.0) * min(SMALL**2, least), to_request))


# Other methods are compared with a better run of dop853. Its tolerance is tightened until its own
# error is small beside the distance.


def search_by_comparison(job: Job, request: float, runs: list[Trajectory]) -> Search:
    """Search with any method for a run whose rms error is at most `request` [m]."""
    size = longer_side(job.scene)
    method = METHODS[job.options.integrator]
    if method.adaptive:
        order = 1.0
        least = _smallest_tolerance(job)
        setting = max(request, least)
    else:
        order = method.order_of(job.scene)
        setting = _longest_dt(job, method.name)
        least = min(job.duration / MANY_STEPS, setting / 4)
    better = _BetterRun(job, SMALL**2 * request)
    best = None
    best_setting = setting
    error = Estimate()
    stalls = 0
    for number in range(RUNS):
        try:
            if method.adaptive:
                run = yield from _run_at_tolerance(job, setting)
            else:
                run = yield _with_fixed_step(job, setting)
            if best is None:
                best = run
            if contact := (yield from better.reason_of_contact(run)):
                return run, Estimate(reason=contact)
            estimate = yield from better.measure_error(run)
            if estimate.rms >= error.rms / 2 and better.tighten_tolerance(
                min(request / estimate.rms, 1.0)
            ):
                estimate = yield from better.measure_error(run)
        except FAILURES:
            if setting <= least or number == RUNS - 1:
                if best is None:
                    raise
                return best, error._replace(reason=Reason.UNSTABLE)
            setting = max(setting / 2, least)
            continue
        stalls = stalls + 1 if estimate.rms > error.rms / 2 else 0
        out_of_phase = estimate.rms > SMALL**2 * size
        # A wrong phase takes more than one smaller setting to come back. It does come back where
        # better runs agree.
        phase_returns = out_of_phase and better.distance_of_better_runs <= SMALL * estimate.rms
        if estimate.rms < ROUNDING * size:
            most_stalls = 1
            fall = SMALL
        else:
            most_stalls = 2
            fall = SMALL**3
        hopeless = stalls >= most_stalls and (setting / best_setting) ** order <= fall
        if not estimate.rms >= error.rms:
            best = run
            best_setting = setting
            error = estimate
        if estimate.rms <= request:
            return run, estimate
        if hopeless and not phase_returns:
            return best, error._replace(reason=Reason.LEAST.format(most=MOST_COST))
        if setting <= least:
            return best, error._replace(reason=Reason.NO_FINER.format(steps=MANY_STEPS))
        # The order predicts an error only where the phase of the motion is right.
        factor = (request / (MARGIN * estimate.rms)) ** (1 / order)
        factor = max(factor, SMALL if out_of_phase else SMALL**4)
        next_setting = max(setting * min(factor, 1 - SMALL), least)
        next_evaluations = run.evaluations * setting / next_setting
        if (
            stalls >= 2
            and not phase_returns
            and _sum_of_evaluations(runs) + next_evaluations > better.affordable_evaluations
        ):
            return best, error._replace(reason=Reason.LEAST.format(most=MOST_COST))
        setting = next_setting
    assert best is not None
    return best, error._replace(reason=Reason.NOT_REACHED.format(runs=RUNS))


def _search_estimate(job: Job, run: Trajectory) -> Search:
    """Estimate the error of a run by a better run."""
    better = _BetterRun(job, SMALL**6 * longer_side(job.scene))
    if contact := (yield from better.reason_of_contact(run)):
        return run, Estimate(reason=contact)
    return run, (yield from better.measure_error(run))


class _BetterRun:
    """The better run that others are compared with."""

    def __init__(self, job: Job, tolerance: float) -> None:
        options = replace(job.options, integrator="dop853", precision="double", backend="cpu")
        self._job = _without_frames(job, options=options, dt=None)
        self._smallest = _smallest_tolerance(self._job)
        self._tolerance = tolerance
        self._run: Trajectory | None = None
        self._looser_run: Trajectory | None = None

    def make_run(self) -> Attempt:
        if self._run is None:
            self._run = yield from _run_at_tolerance(self._job, self._tolerance)
        return self._run

    @property
    def distance_of_better_runs(self) -> float:
        """Distance of the better run from the looser one before it [m], rms; inf without one."""
        if self._run is None or self._looser_run is None:
            return math.inf
        return rms_distance(self._run.x[-1] - self._looser_run.x[-1])

    @property
    def affordable_evaluations(self) -> float:
        """Force evaluations that are affordable where errors do not fall."""
        assert self._run is not None
        fall = (self._tolerance / self._smallest) ** (1 / ORDER)
        return float(MOST_COST * self._run.evaluations * fall)

    def reason_of_contact(self, run: Trajectory) -> Generator[Job, Trajectory, str]:
        """Say why a response of a sphere in one of two runs leaves no estimate, or return ""."""
        if run.has_contacts:
            return Reason.CONTACT
        better = yield from self.make_run()
        return Reason.MISSED if better.has_contacts else ""

    def measure_error(self, run: Trajectory) -> Generator[Job, Trajectory, Estimate]:
        """Measure the distance from a better run whose own error does not matter."""
        while True:
            better = yield from self.make_run()
            error = Estimate.from_better_positions(run.x[-1], better.x[-1], MARGIN)
            growth = 1.0  # error of the looser better run over the sum of its local errors
            if self._looser_run is not None:
                growth = max(
                    self.distance_of_better_runs / max(self._looser_run.local_error, 1e-300), 1.0
                )
            part = SMALL * error.rms / max(growth * better.local_error, 1e-300)
            if part >= 1 or error.rms <= self._smallest or not self.tighten_tolerance(part):
                return error

    def tighten_tolerance(self, part: float) -> bool:
        """Give the better run a smaller tolerance, and return whether there is one.

        It is well below this part of the present tolerance.
        """
        if self._tolerance <= self._smallest:
            return False
        self._tolerance = max(SMALL * part * self._tolerance, self._smallest)
        self._looser_run = self._run
        self._run = None
        return True
