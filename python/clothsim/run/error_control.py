"""Error control: from the error that is asked for to a run that has it, and the estimate of it.

The request is for the rms error over the mass points at the end of the run: ``atol + rtol * size``.
The size is the longer side of the cloth.

The estimate is the distance of the run from a better run of the same scene. The better run takes
other steps and rounds differently, so the distance includes rounding errors.

A search is a function from the trajectories so far to the job of the next run, or to the end: a
generator that yields a `Job`, is sent its `Trajectory`, and returns the trajectory to hand over and
its error. `refined` is the search for dop853 in double and for rkc2, which "auto" takes, after
`halved` for undamped cloths; `compared` serves all other methods. After a response that is no force
no error is estimated. Both make `RUNS` runs at most; docs/dev/error-control.md says why each run
ends.
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
from ..methods.bound import usable_dt
from ..methods.integrators import METHODS
from ..model.scene import Scene, stops_of
from .reasons import Reason
from .trajectory import Frames, Job, Recorder, Trajectory, Watch

MANY_STEPS = 1_000_000  # a fixed-step method takes no more to reach a tolerance

# Each constant is a ratio, found on the scenes of `benchmarks/error_control.py --stream tune`.
# docs/dev/error-control.md has the effect of half and twice of each.

# Part of the run from which the number of steps is estimated.
PILOT = 0.05
# Estimates are taken times this, and proportional is what differs by less.
MARGIN = 1.4
# Local errors of a better run are neglected below this part of an error.
SMALL = 0.1
# Runs of one method at most.
RUNS = 8
# The smallest tolerance of a step, over the size: some fifty roundings of a position in double.
# Single precision keeps what a step adds with fewer digits, and compensates the sum.
SMALLEST = {"double": 1e-14, "single": 1e-8}
# Distance of runs over the size from which on they count as parted, if it does not fall with their
# local errors: a hundred times what rounding leaves of most motions.
LOST = 1e-7
# Below this error over the size, rounding may be a part of a difference, and does not fall with m.
ROUNDING = 1e-9
# Tolerance of a step of a short run over the error that is asked for.
TOLERANCE = 1.5
# Radians, approximately, of the fastest motion above which tolerances fall with their cube. Each
# step adds an error, and an error of frequency moves positions apart with the square of time.
GROWTH = 12.0
# Steps of the second run over those of the first.
REFINEMENT = {"dop853": 1.25, "rkc2": 1.5}
# Steps below which no error is extrapolated: the sum of few local errors is a poor estimate.
FEW = 60

ORDER = METHODS["dop853"].order
# Least by which errors fall with more steps in contact, and in wind: a triangle that turns through
# the wind has all but a kink in its force.
ORDER_OF_KINKS = 2
# A promise, not a setting: force evaluations of everything over those of a run at the smallest
# tolerance.
MOST = 3.0
# Evaluations of a step of rkc2 grow with the root of its length.
_POWER_OF_STEPS = {"dop853": 1.0, "rkc2": 0.5}
# Part of the local errors that a later refinement leaves, at most and at least.
_FALL, _LEAST_FALL = REFINEMENT["dop853"] ** -ORDER, SMALL**4

# Of the size: the smallest error for which fixed steps of Verlet are tried, and how often these are
# halved at most.
LOOSE = 1e-6
HALVINGS = 2
# By how much errors of Verlet fall with half the step: assumed of two runs, and of three at least,
# as otherwise they do not resolve the motion.
ASSUMED_FALL, LEAST_FALL, MOST_FALL = 3.0, 2.0, 4.0


def size_of(scene: Scene) -> float:
    """Return the longer side of the cloth [m], to which a relative tolerance refers."""
    return max(scene.cloth.size)


def rms(difference: Floats) -> float:
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
    def of(cls, x: Floats, better: Floats, factor: float) -> Estimate:
        """Return `factor` times the distance from better positions, as an error.

        Half a unit in the last place is added: equal positions are rounded too.
        """
        distances = factor * np.linalg.norm(x - better, axis=-1) + np.spacing(np.abs(x).max()) / 2
        return cls(float(distances.max()), float(np.sqrt((distances**2).mean())))


class Controlled(NamedTuple):
    """A trajectory, its error, and force evaluations of the runs that are not returned."""

    trajectory: Trajectory
    error: Estimate
    evaluations: int


FAILED = (UnstableError, ContactError)  # how a fixed step that is too long ends a run

Search = Generator[Job, Trajectory, tuple[Trajectory, Estimate]]
Step = Generator[Job, Trajectory, Trajectory]  # a part of a search, which finds a run


def solve(job: Job, asked: float, watch: Watch, auto: bool = False) -> Controlled:
    """Search for a run whose rms error is at most `asked` [m], and return it or the best run.

    `auto`: the method is not the caller's, and Verlet is tried first where it may cost less.
    """
    stops_of(
        job.scene, job.start, job.start + job.duration
    )  # refuses too many before the first run
    done: list[Trajectory] = []
    if job.options.integrator in _POWER_OF_STEPS and job.options.precision == "double":
        search = refined(job, asked, done)
        if auto and asked >= LOOSE * size_of(job.scene) and _conservative(job):
            search = halved(job, asked, search)
        return _conduct(search, done, watch)
    return _conduct(compared(job, asked, done), done, watch)


def estimate_of(job: Job, run: Trajectory) -> Controlled:
    """Estimate the error of a run."""
    done = [run]
    return _conduct(_estimated(job, run), done, Watch())


def _conduct(search: Search, done: list[Trajectory], watch: Watch) -> Controlled:
    finished = recorder = watch.recorder
    warned: set[str] = set()  # by the runs of the search: each warning is given once
    go_on: Callable[[Any], Job] = search.send
    answer: Any = None
    try:
        while True:
            try:
                job = go_on(answer)
            except StopIteration as end:
                best, error = end.value
                break
            recorder = Recorder(job, watch if job.shown else Watch(), quiet=frozenset(warned))
            try:
                done.append(recorder.run().trajectory())
                go_on, answer, finished = search.send, done[-1], watch.recorder
            except UnstableError as failure:
                go_on, answer = search.throw, failure
            except ContactError as failure:
                if job.dt is None:  # steps that meet their tolerance: the solution goes through
                    raise
                go_on, answer = search.throw, failure
            warned |= recorder.state.judge.warned
    except KeyboardInterrupt:  # the last run that came to its end is handed over
        watch.recorder = finished or watch.recorder or recorder
        raise
    return Controlled(best, error, sum(run.evaluations for run in done if run is not best))


def _evaluations(done: list[Trajectory]) -> int:
    return sum(run.evaluations for run in done)


def _smallest(job: Job) -> float:
    """Return the smallest tolerance of a step [m]."""
    return SMALLEST[job.options.precision] * size_of(job.scene)


def _unseen(job: Job, **changes: object) -> Job:
    """Return a job without frames, for a run that is not returned."""
    return replace(job, shown=False, frames=Frames(), **changes)  # type: ignore[arg-type]


def _at_tolerance(job: Job, tolerance: float) -> Step:
    """Run at a tolerance of a step [m].

    If the tolerance lets stiff motion grow until the run is unstable, it is repeated at a smaller
    tolerance.
    """
    smallest = _smallest(job)
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
    stable = usable_dt(job.scene, integrator)
    return min(stable / 2 if job.scene.spheres else stable, job.duration / 4)


def _fixed(job: Job, dt: float) -> Job:
    """Return a job with equal steps of at most `dt`, which the caller did not choose."""
    longest = _longest_dt(job, job.options.integrator)
    step = job.duration / math.ceil(job.duration / dt)
    return replace(job, dt=step, own_step=True, longest=longest)


# Fixed steps that are halved (Richardson): where stability sets the step, the error at the longest
# stable step is often small enough, and Verlet evaluates forces once a step.


def _conservative(job: Job) -> bool:
    """Return whether springs and constant forces alone act, for which Verlet keeps its order."""
    scene = job.scene
    return not (scene.damped or scene.spheres or scene.cloth.driven or job.force)


def halved(job: Job, asked: float, otherwise: Search) -> Search:
    """Search with Verlet, from the longest stable step on, by halving it.

    If no run has an rms error of at most `asked` [m], the search `otherwise` follows.
    """
    verlet = replace(job, options=replace(job.options, integrator="velocity_verlet"))
    count = math.ceil(job.duration / _longest_dt(verlet, "velocity_verlet"))
    fall, earlier = ASSUMED_FALL, math.inf
    with suppress(*FAILED):
        before = yield _unseen(_fixed(verlet, job.duration / count))
        for k in range(1, HALVINGS + 1):
            after = yield _fixed(verlet, job.duration / (2**k * count))
            distance = rms(after.x[-1] - before.x[-1])
            if earlier < math.inf:
                fall = min(earlier / max(distance, 1e-300), MOST_FALL)
            error = Estimate.of(after.x[-1], before.x[-1], MARGIN / (max(fall, LEAST_FALL) - 1))
            if error.rms <= asked and fall >= LEAST_FALL:
                return after, error
            if fall < LEAST_FALL or error.rms > MOST_FALL * asked:
                break
            before, earlier = after, distance
    return (yield from otherwise)


# dop853 and rkc2 in double: grids that are refined (Shampine, Watts: Global error estimation for
# ordinary differential equations, ACM TOMS 2 (1976) 172), and tolerances (Stetter: Considerations
# concerning a theory for ODE-solvers, 1978) where errors are not proportional;
# docs/dev/error-control.md has the algorithm.


def refined(job: Job, asked: float, done: list[Trajectory]) -> Search:
    """Search with dop853 or rkc2 for a run whose rms error is at most `asked` [m]."""
    tolerance = yield from _first_tolerance(job, asked)
    before = first = yield from _at_tolerance(job, tolerance)
    if first.contacts:
        return first, Estimate(reason=Reason.CONTACT)
    best, error, least = first, Estimate(), math.inf
    finer = _Finer(job, first)
    most = MOST * finer.evaluations_of_finest
    growth = 0.0  # of errors: the largest distance of a pair over the local errors of its first run
    parting = Parting(size_of(job.scene))

    def ended(reason: str) -> tuple[Trajectory, Estimate]:
        return best, parting.judged(error._replace(reason=reason))

    for number in range(1, RUNS):
        if _evaluations(done) + finer.evaluations > most:
            return ended(Reason.LEAST.format(most=MOST))
        try:
            after = yield from finer.run()
        except UnstableError:
            if finer.is_finest or number == RUNS - 1:
                return ended(Reason.UNSTABLE)
            finer.refine(finer.fall * _FALL)
            continue
        if after.contacts:
            return after, Estimate(reason=Reason.CONTACT)
        if _alike(before, after, finer.refinement):  # which says nothing about the error of either
            if finer.is_finest:
                return ended(Reason.LEAST.format(most=MOST))
            finer.refine(finer.fall * SMALL**2)
            continue
        pair = _Pair(before, after, finer.by_grid, growth)
        growth = max(growth, pair.growth)
        parting.note(before, pair.distance)
        if pair.before.rms <= asked:
            return before, pair.before
        if pair.extrapolates and pair.after.rms <= asked and asked >= ROUNDING * size_of(job.scene):
            return after, pair.after
        stalled = pair.before.rms > least * max(0.5, MARGIN * finer.first_fall)
        hopeless = stalled and before.local_error <= SMALL**3 * best.local_error
        if pair.before.rms < least:
            # The finer of two that are near: its error is at most about their distance.
            best, error = after, pair.before
            least = pair.before.rms
        elif stalled:
            # The least of several distances may be small by chance.
            error = max(
                error, Estimate.of(best.x[-1], after.x[-1], MARGIN), key=lambda one: one.rms
            )
        if finer.is_finest or hopeless:
            return ended(Reason.LEAST.format(most=MOST))
        finer.choose(pair, asked, SMALL**2 if stalled else _FALL)
        before = after
    return ended(Reason.NOT_REACHED.format(runs=RUNS))


def _alike(before: Trajectory, after: Trajectory, refinement: float) -> bool:
    """Return whether two runs took all but the same steps: where motions set them, tolerances do
    not.
    """
    return (
        after.steps < (1 + refinement) / 2 * before.steps
        and after.local_error > SMALL * before.local_error
    )


class Parting:
    """Whether runs with smaller local errors approach each other."""

    def __init__(self, size: float) -> None:
        self._floor, self._lost = LOST * size, SMALL**2 * size
        self._pairs: list[tuple[float, float]] = []  # local error and distance, of each pair

    def note(self, run: Trajectory, distance: float) -> None:
        self._pairs.append((run.local_error, distance))

    def judged(self, error: Estimate) -> Estimate:
        """Return the estimate, without a number where the distances did not fall, or are so large
        that the runs tell nothing of each other.
        """
        if not self._pairs or not error.rms > self._floor:
            return error
        left, distance = self._pairs[-1]
        if distance > self._lost or any(
            d <= distance and left <= e / 2 for e, d in self._pairs[:-1]
        ):
            return Estimate(reason=Reason.APART.format(distance=distance))
        return error


def _first_tolerance(job: Job, asked: float) -> Generator[Job, Trajectory, float]:
    """Estimate the tolerance of a step [m] that gives a run about the error asked for.

    The number of steps times tolerance^(1/p) measures how far the motion goes, at any tolerance.
    Errors of damped motion are forgotten.
    """
    tolerance, steps = TOLERANCE * asked, 0.0
    if job.options.integrator == "rkc2":  # damped motion forgets its errors
        return tolerance
    with suppress(UnstableError):
        part = max(tolerance, _smallest(job))
        steps = (yield _unseen(job, duration=PILOT * job.duration, tolerance=part)).steps / PILOT
    _, damping = _core.mode_bounds(job.scene.cloth.core, job.scene.core_forces)
    motion = steps * (tolerance / size_of(job.scene)) ** (1 / ORDER)
    kept = 1 + damping * job.duration / 2
    return float(tolerance / (1 + (motion / kept / GROWTH) ** 3))


class _Pair:
    """Two runs, the second one with smaller local errors: the errors of both."""

    def __init__(self, before: Trajectory, after: Trajectory, by_grid: bool, growth: float) -> None:
        """Compare two runs.

        `growth` is that of errors in earlier pairs. A pair that is closer than it lets expect may
        be so by chance.
        """
        x, better = before.x[-1], after.x[-1]
        self.distance = rms(x - better)
        self.growth = self.distance / max(before.local_error, 1e-300)
        chance = max(SMALL * growth / max(self.growth, 1e-300), 1.0)
        self.left = before.local_error, after.local_error
        found = self.left[1] / max(self.left[0], 1e-300)
        # A contact adds errors that fall more slowly than those of smooth motion.
        kinks = after.watched["in_contact"] or after.scene.wind is not None
        order = METHODS[after.options.integrator].order
        if kinks:
            order = min(order, ORDER_OF_KINKS)
        m = min((before.steps / after.steps) ** order if by_grid else found, 1 - SMALL)
        # Errors of rkc2 near its stable step fall faster than their order.
        least = 0.0 if after.options.integrator == "rkc2" else 1 / MARGIN
        self.proportional = by_grid and least <= found / m <= MARGIN
        self.extrapolates = self.proportional and m >= SMALL and after.steps >= FEW
        self.before = Estimate.of(x, better, chance * MARGIN / (1 - m))
        m = min(max(found, m), 1 - SMALL)
        self.after = Estimate.of(x, better, chance * MARGIN * m / (1 - m))


class _Finer:
    """The next run: on the grid of the first run, refined, or by a tolerance."""

    def __init__(self, job: Job, first: Trajectory) -> None:
        self._job, self._first = job, first
        self._smallest = _smallest(job) / first.tolerance
        self._order = METHODS[job.options.integrator].order
        self.refinement = REFINEMENT[job.options.integrator]
        self.by_grid = True
        self.first_fall = self.refinement**-self._order
        self.fall = self.first_fall  # local errors of the run over those of the first
        self.evaluations_of_finest = self._evaluations_at(self._smallest)

    @property
    def evaluations(self) -> float:
        return self._evaluations_at(self.fall)

    def _evaluations_at(self, fall: float) -> float:
        power = _POWER_OF_STEPS[self._job.options.integrator] / self._order
        return float(self._first.evaluations * fall**-power)

    @property
    def _finest(self) -> float:
        return self._smallest * (_FALL if self.by_grid else 1.0)

    @property
    def is_finest(self) -> bool:
        return self.fall <= self._finest

    def run(self) -> Step:
        first = self._first
        if not self.by_grid:
            return (yield from _at_tolerance(self._job, self.fall * first.tolerance))
        return (
            yield replace(
                self._job,
                tolerance=first.tolerance,
                grid=first.refined(self.fall ** (-1 / self._order)),
            )
        )

    def refine(self, fall: float) -> None:
        self.fall = max(fall, self.fall * _LEAST_FALL, self._finest)

    def choose(self, pair: _Pair, asked: float, least: float) -> None:
        """Choose the run to have the error asked for; local errors fall by `least` at least."""
        if pair.proportional:
            self.refine(self.fall * min(asked / pair.after.rms, least))
            return
        self.by_grid = False
        before, after = (error / self._first.local_error for error in pair.left)
        self.refine(min(min(after, 1.0) * min(SMALL**2, least), before * asked / pair.before.rms))


# Other methods: the tolerance of a better run of dop853 is tightened until its own error is small
# beside the distance.


def compared(job: Job, asked: float, done: list[Trajectory]) -> Search:
    """Search with any method for a run whose rms error is at most `asked` [m]."""
    size, method = size_of(job.scene), METHODS[job.options.integrator]
    if method.adaptive:
        least, order = _smallest(job), 1.0
        setting = first = max(asked, least)
    else:
        setting = first = _longest_dt(job, method.name)
        least, order = min(job.duration / MANY_STEPS, first / 4), method.order_of(job.scene)
    better = _Better(job, SMALL**2 * asked)
    best, error = None, Estimate()
    best_setting, stalls = setting, 0
    for number in range(RUNS):
        try:
            if method.adaptive:
                run = yield from _at_tolerance(job, setting)
            else:
                run = yield _fixed(job, setting)
            if best is None:
                best = run
            if contact := (yield from better.contact(run)):
                return run, Estimate(reason=contact)
            found = yield from better.error_of(run)
            if found.rms >= error.rms / 2 and better.tighten(min(asked / found.rms, 1.0)):
                found = yield from better.error_of(run)
        except FAILED:
            if setting <= least or number == RUNS - 1:
                if best is None:
                    raise
                return best, error._replace(reason=Reason.UNSTABLE)
            setting = max(setting / 2, least)
            continue
        stalls = stalls + 1 if found.rms > error.rms / 2 else 0
        tiny, lost = found.rms < ROUNDING * size, found.rms > SMALL**2 * size
        # A phase that is lost takes more than one smaller setting to come back. It does come back
        # where better runs agree.
        known = lost and better.agreement <= SMALL * found.rms
        fewest, fall = (1, SMALL) if tiny else (2, SMALL**3)
        hopeless = stalls >= fewest and (setting / best_setting) ** order <= fall
        if not found.rms >= error.rms:
            best, error, best_setting = run, found, setting
        if found.rms <= asked:
            return run, found
        if hopeless and not known:
            return best, error._replace(reason=Reason.LEAST.format(most=MOST))
        if setting <= least:
            return best, error._replace(reason=Reason.NO_FINER.format(steps=MANY_STEPS))
        # The order predicts an error only where the phase of the motion is not lost.
        wanted = max((asked / (MARGIN * found.rms)) ** (1 / order), SMALL if lost else SMALL**4)
        finer = max(setting * min(wanted, 1 - SMALL), least)
        if (
            stalls >= 2
            and not known
            and _evaluations(done) + run.evaluations * setting / finer > better.most
        ):
            return best, error._replace(reason=Reason.LEAST.format(most=MOST))
        setting = finer
    assert best is not None
    return best, error._replace(reason=Reason.NOT_REACHED.format(runs=RUNS))


def _estimated(job: Job, run: Trajectory) -> Search:
    """Estimate the error of a run by a better run."""
    better = _Better(job, SMALL**6 * size_of(job.scene))
    if contact := (yield from better.contact(run)):
        return run, Estimate(reason=contact)
    return run, (yield from better.error_of(run))


class _Better:
    """The better run, which others are compared with."""

    def __init__(self, job: Job, tolerance: float) -> None:
        options = replace(job.options, integrator="dop853", precision="double", backend="cpu")
        self._job = _unseen(job, options=options, dt=None)
        self._smallest = _smallest(self._job)
        self._tolerance = tolerance
        self._run: Trajectory | None = None
        self._looser: Trajectory | None = None

    def run(self) -> Step:
        if self._run is None:
            self._run = yield from _at_tolerance(self._job, self._tolerance)
        return self._run

    @property
    def agreement(self) -> float:
        """The distance of the better run from the one before it [m], rms; infinite without one."""
        return rms(self._run.x[-1] - self._looser.x[-1]) if self._run and self._looser else math.inf

    @property
    def most(self) -> float:
        """Force evaluations that are affordable where errors do not fall."""
        assert self._run is not None
        return float(
            MOST * self._run.evaluations * (self._tolerance / self._smallest) ** (1 / ORDER)
        )

    def contact(self, run: Trajectory) -> Generator[Job, Trajectory, str]:
        """Say why a response of a sphere in one of two runs leaves no estimate, or return ""."""
        if run.contacts:
            return Reason.CONTACT
        better = yield from self.run()
        return Reason.MISSED if better.contacts else ""

    def error_of(self, run: Trajectory) -> Generator[Job, Trajectory, Estimate]:
        """Measure the distance from a better run whose own error does not matter."""
        while True:
            better = yield from self.run()
            error = Estimate.of(run.x[-1], better.x[-1], MARGIN)
            # Of errors: that of the looser of two better runs over the sum of its local errors.
            growth = 1.0
            if self._looser is not None:
                growth = max(self.agreement / max(self._looser.local_error, 1e-300), 1.0)
            part = SMALL * error.rms / max(growth * better.local_error, 1e-300)
            if part >= 1 or error.rms <= self._smallest or not self.tighten(part):
                return error

    def tighten(self, part: float) -> bool:
        """Give the better run a smaller tolerance, well below this part of the present one; False
        if there is none.
        """
        if self._tolerance <= self._smallest:
            return False
        self._tolerance = max(SMALL * part * self._tolerance, self._smallest)
        self._looser, self._run = self._run, None
        return True
