"""One run of a scene, or of the scenes of a batch side by side: a `Job` becomes a `Trajectory` for
each scene.

One loop serves fixed steps and error control. It goes from frame to frame; the core takes the steps
between two frames by itself. Frames never change a run: a frame between two steps is interpolated.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats, check
from ..engine.force import forces_of
from ..engine.judge import TIME_STEP
from ..engine.options import Options
from ..engine.snapshot import Snapshot, of_members
from ..engine.state import State, put_driven_pins
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..methods.integrators import METHODS
from ..model.scene import Scene, stops_of
from ..model.sphere import Plane, Sphere
from ..typing import Force

Callback = Callable[[float, Floats, Floats], Any]
Failure = UnstableError | ContactError
Pair = tuple[Floats, Floats]  # positions and velocities
Moment = tuple[float, float]  # seconds since the start of the run, and the time of the scene [s]
# The tolerance of a step [m], the weight of velocities in it [1/s] and the state of the core's
# controller.
ControlValues = tuple[float, float, tuple[float, float, bool]]

# Called between steps; may raise to end a run, as for a sweep whose runs are on threads that Ctrl-C
# does not reach.
PAUSE: ContextVar[Callable[[], None] | None] = ContextVar("PAUSE", default=None)

# A remainder below this part of a step is rounding of the caller's numbers, not a step.
NEGLIGIBLE = 1e-9
_MOST_FRAMES = 10_000_000  # whose times alone take 1 GB
_SECONDS_BETWEEN_SHOWS = 0.1  # of the progress bar, and between two pauses
# Velocities are weighed against positions by a frequency above all of the cloth: this many times
# the bound on its frequencies. Errors of x then decide, and those of v are held to the same scale.
_VELOCITY_WEIGHT = 3.0
_ROUNDING = 4e-16  # of a time over the step size, as part of it
_ANY_ERROR = 1e12  # Times the tolerance of a step: errors up to here are taken as they are.
_NEW_CONTROLLER = 1e-4, False  # its previous error, and whether it has just rejected a step
# States at which triangles and stretches are sampled, at least, and most steps between two of them.
# An adaptive method's steps are several times as long.
_SAMPLES = 32
_MOST_STEPS_BETWEEN_SAMPLES = 128
_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES = 16


@dataclass(frozen=True)
class Frames:
    """When frames are stored between the first and the last state; by default there are none. At
    most one field is set.
    """

    every: int | float | None = None  # steps (int) or seconds (float) between frames
    fps: float | None = None
    times: tuple[float, ...] = ()  # of the scene [s], increasing

    @classmethod
    def of(cls, every: Any, times: Any, fps: Any, start: float, duration: float) -> Frames:
        """The frames for the arguments of `simulate`, checked."""
        given = [
            name
            for name, value in (("every", every), ("times", times), ("fps", fps))
            if value is not None
        ]
        if len(given) > 1:
            raise ValueError(
                f"at most one of every, times and fps can be given, got {' and '.join(given)}"
            )
        if times is not None:
            return cls(times=_checked_times(times, start, duration))
        if fps is not None:
            fps = check.number("fps", fps, minimum=0, exclusive=True)
        return cls(checked_every(every), fps)

    @property
    def steps(self) -> int:
        """Steps between frames; 0 where they are not counted in steps."""
        return self.every if isinstance(self.every, int) else 0

    def moments(self, start: float, begin: float, end: float, dt: float | None) -> list[Moment]:
        """Moments from `begin` to `end`, both included, of steps of `dt`; without it frames in
        steps have no moments.

        `begin` and `end` are seconds since the run started, at the time `start`.
        """
        every = self.steps * (dt or 0.0) if self.steps else self.every
        if self.times:
            near = NEGLIGIBLE * (end - begin)
            inner = [(t - start, t) for t in self.times if begin + near < t - start < end - near]
        else:
            first, last = (
                offset / every if every else offset * (self.fps or 0.0) for offset in (begin, end)
            )
            if not last - first < _MOST_FRAMES:
                name = "fps" if self.fps else "every"
                raise ValueError(
                    f"{name} must give fewer than {_MOST_FRAMES:,} frames, got "
                    f"{self.fps or self.every:g}"
                )
            numbers = range(math.floor(first + NEGLIGIBLE) + 1, math.ceil(last - NEGLIGIBLE))
            offsets = [k * every if every else k / (self.fps or 1.0) for k in numbers]
            inner = [(offset, start + offset) for offset in offsets]
        return [(begin, start + begin), *inner, (end, start + end)]


def checked_every(every: Any) -> int | float | None:
    """Check `every`: steps (int) or seconds (float)."""
    if isinstance(every, (int, np.integer)):
        return check.integer("every", every, minimum=1)
    return None if every is None else check.number("every", every, minimum=0, exclusive=True)


def _checked_times(times: Any, start: float, duration: float) -> tuple[float, ...]:
    end = start + duration
    accepted = f"increasing times [s] from {start:g} to {end:g}"
    given = check.as_array("times", times, accepted)
    if given.ndim != 1 or not given.size:
        raise ValueError(f"times must be {accepted}, in one dimension, got shape {given.shape}")
    found = given.astype(np.float64)
    slack = NEGLIGIBLE * duration
    rising = np.append(True, found[1:] > found[:-1])
    check.check_all(
        "times", found, rising & (found >= start - slack) & (found <= end + slack), accepted
    )
    return tuple(found.tolist())


@dataclass(frozen=True)
class Continuation:
    """The settings of a run, for its continuation: plain data, but for `frames`."""

    start: float  # time of the start [s]
    seconds: float = 0.0  # duration of the run so far
    steps: int = 0  # since the start
    dt: float | None = None  # time step [s]; None with error control
    frames: Frames = Frames()
    control: ControlValues | None = None  # with error control
    forced: bool = False  # by a function, which is no data


@dataclass(frozen=True)
class Job:
    """What one run computes: with fixed steps of `dt`, or else with error control.

    `own_step`: the step is not the caller's, so no warning names it, and no snapshot of a batch is
    kept. `shown`: the callback and the progress bar follow the run.
    """

    scenes: list[Scene]
    batched: bool  # whether a sequence of scenes was given
    duration: float  # [s]
    options: Options
    start: float = 0.0  # time of the initial state [s]
    frames: Frames = Frames()
    force: Force | list[Force] | None = None
    dt: float | None = None  # [s]
    own_step: bool = False
    longest: float = math.inf  # own steps between two kinks are equal parts of steps of this [s]
    shown: bool = True
    tolerance: float = math.nan  # of a step [m]
    grid: tuple[float, ...] = ()  # prescribed ends of steps
    resumed: tuple[Snapshot, Continuation] | None = None  # the end of the run to continue

    @property
    def scene(self) -> Scene:
        return self.scenes[0]


@dataclass(kw_only=True)
class Trajectory:
    """A run of a scene, or its part so far: frames, cost, extremes over all states, local error."""

    scene: Scene
    options: Options
    t: list[float]
    x: Floats
    v: Floats
    steps: int
    rejected: int
    evaluations: int
    wall_time: float  # of stepping [s]
    step: float  # fixed: the time step, adaptive: the mean one [s]
    watched: Mapping[str, Any]  # extremes over the states, see Watched in the core
    state: State
    saved: (
        dict[str, Any] | None
    )  # the fields of the core for a member of a batch, which `state` steps
    continuation: Continuation
    tolerance: float = math.nan  # of a step [m], with error control
    ends: list[float] = field(default_factory=list)  # of its steps
    kinks: list[int] = field(default_factory=list)  # steps before each kink of a motion
    local_error: float = 0.0  # sum of the method's own estimates of the steps' errors [m]

    @property
    def contacts(self) -> bool:
        return bool(self.watched["responded"])

    def refined(self, ratio: float) -> tuple[float, ...]:
        """Ends of a grid with `ratio` times as many steps between two kinks, with times
        interpolated linearly.
        """
        ends, finer = [self.t[0], *self.ends], []
        for first, last in pairwise([0, *self.kinks, len(self.ends)]):
            count = last - first
            numbers = np.linspace(
                0, count, max(count + 1, math.ceil(ratio * count - NEGLIGIBLE)) + 1
            )[1:]
            finer += np.interp(numbers, np.arange(count + 1), ends[first : last + 1]).tolist()
        return tuple(finer)


class StopRun(Exception):
    """Raised to end a run that the callback stops."""


class Watch:
    """Follows the runs of one call of `simulate`.

    `callback` is called with (t, x, v) at each frame, and stops the run by returning True. `bar` is
    a bar of tqdm that counts simulated seconds. `recorder` has the present run, or the last run
    that ended.
    """

    def __init__(self, callback: Callback | None = None, bar: Any = None) -> None:
        self._callback, self.bar = callback, bar
        self._here = 0.0
        self.recorder: Recorder | None = None

    def begin(self, recorder: Recorder, seconds: float) -> None:
        """Start to follow a run whose first state is `seconds` after its start."""
        self.recorder, self._here = recorder, seconds
        if self.bar is not None:
            self.bar.reset()

    def passed(self, seconds: float) -> None:
        if self.bar is not None:
            self.bar.update(seconds - self._here)
            self._here = seconds

    def frame(self, t: float, x: Floats, v: Floats) -> None:
        if self._callback is None:
            return
        stop = self._callback(t, *map(_constant, (x, v)))
        if stop is not None and not isinstance(stop, (bool, np.bool_)):
            raise TypeError(
                "callback must return True to stop the run, or False or None to go on, got "
                f"{check.shown(stop)}"
            )
        if stop:
            raise StopRun


def _constant(values: Floats) -> Floats:
    """A copy that nobody can change."""
    return np.frombuffer(values.tobytes()).reshape(values.shape)


class _Stack:
    """Frames of a cloth, stacked as they come: to stack thousands of them at the end would hold
    back Ctrl-C.
    """

    def __init__(self, shape: tuple[int, ...], count: int) -> None:
        self.t: list[float] = []
        self.seconds = 0.0  # of the last frame, since the start of the run
        self.x: Floats = np.empty((count, *shape))
        self.v: Floats = np.empty((count, *shape))

    def put(self, seconds: float, t: float, x: Floats, v: Floats) -> None:
        k = len(self.t)
        if k == min(len(self.x), len(self.v)):
            self.resize(k + 1 + k // 8)
        self.x[k], self.v[k] = x, v
        self.seconds = seconds
        self.t.append(t)  # last: a frame counts from here on

    def resize(self, count: int) -> None:
        for stack in (self.x, self.v):
            if count != len(stack):
                stack.resize((count, *stack.shape[1:]), refcheck=False)


def _steps(begin: float, end: float, dt: float, longest: float) -> int:
    """Return how many equal steps of at most `dt` there are: so many parts of each of the longest,
    so that a shorter step is shorter between all kinks.
    """
    if not longest < math.inf:
        longest = dt
    whole = math.ceil((end - begin) / longest - NEGLIGIBLE)
    return whole * math.ceil(longest / dt - NEGLIGIBLE)


class Recorder:
    """A job in progress: advances `state`, and keeps the frames and the counts of its runs.

    `steps` counts accepted steps. `live` has the members of a batch that go on, `failed` the error
    and the run so far of each other member.
    """

    def __init__(self, job: Job, watch: Watch, quiet: frozenset[str] = frozenset()) -> None:
        self.job = job
        self._watch = watch
        forces = forces_of(job.force, job.scenes, job.batched)
        if job.own_step or job.dt is None:
            quiet |= TIME_STEP
        self.state = State.own(job.scenes, job.batched, job.start, job.options, forces, quiet)
        self._earlier = Continuation(job.start)
        if job.resumed:
            snapshot, self._earlier = job.resumed
            core = {
                name: 0 * value if name in ("impulses", "contacts") else value
                for name, value in snapshot.core.items()
            }
            self.state.core.restore(core)  # a report has the impulses of its own run
        begin = self._earlier.seconds
        self.moments = job.frames.moments(job.start, begin, begin + job.duration, job.dt)
        self.steps = 0
        self._wall_time = 0.0  # of stepping and dense output [s]; of a batch, the share of a member
        self._frames = [
            _Stack(shape, len(self.moments)) for shape in [self.state.shape[-3:]] * len(job.scenes)
        ]
        self.live = list(range(len(job.scenes)))
        self.failed: dict[int, tuple[Failure, Trajectory]] = {}
        self._ahead = False  # the present state comes after the last frame
        self._path = self._new_path() if job.dt is None else None
        if job.dt is not None:
            every = min(_MOST_STEPS_BETWEEN_SAMPLES, job.duration / job.dt // _SAMPLES)
            self.state.core.set_watch(int(max(1, every)), 0.0)
        self._chunk, self._pause = 1, PAUSE.get()
        self.store(*self.moments[0])

    def run(self) -> Recorder:
        if self._path:
            self._control(self._path)
        elif self.job.dt is not None:
            if self.job.own_step:
                self._pass_kinks(self.moments, self.job.dt)
            else:
                self._pass_frames(self.moments, self.job.dt)
        return self

    # Fixed steps

    def _pass_kinks(self, moments: Sequence[Moment], dt: float) -> None:
        """Take equal steps of at most `dt` between the kinks of motions, so that none is within a
        step, and store frames as `_pass_frames` does.
        """
        (_, begin), (_, end), start = moments[0], moments[-1], self.job.start
        kinks = {t for scene in self.job.scenes for t in stops_of(scene, begin, end)}
        if not kinks:
            return self._pass_frames(moments, dt)
        stops = [begin, *sorted(kinks), end]
        if every := self.job.frames.steps:
            counts = [_steps(a, b, dt, self.job.longest) for a, b in pairwise(stops)]
            ends = [np.linspace(*way, n + 1)[1:] for way, n in zip(pairwise(stops), counts)]
            inner = np.concatenate(ends)[every - 1 : -1 : every].tolist()
            moments = [moments[0], *((t - start, t) for t in inner), moments[-1]]
        for low, high in pairwise(stops):
            near = NEGLIGIBLE * (high - low)
            inner = [m for m in moments[1:-1] if low + near < m[1] < high - near]
            at_end = [m for m in moments[1:] if abs(m[1] - high) <= near]
            last = at_end[-1] if at_end else (high - start, high)
            part = [(low - start, low), *inner, last]
            dt_here = (high - low) / _steps(low, high, dt, self.job.longest)
            self._pass_frames(part, dt_here, stored=bool(at_end))

    def _pass_frames(self, moments: Sequence[Moment], dt: float, stored: bool = True) -> None:
        """Take steps of `dt` from the first moment to the last, and store a frame at each of the
        others; at the last if it is `stored`. The last step is shorter where the step does not
        divide the time.
        """
        begin, origin = moments[0]
        length = moments[-1][0] - begin
        whole = math.floor(length / dt + NEGLIGIBLE)
        rest = length - whole * dt
        last = rest > NEGLIGIBLE * dt  # there is a shorter last step
        done = 0

        def advance(steps: int) -> None:
            nonlocal done
            if min(steps, whole) > done:
                self.advance(min(steps, whole) - done, dt)
            if steps > whole >= done:
                self.advance(1, rest)
            done = max(done, steps)

        between: tuple[float, float, Pair, Pair] | None = None
        for seconds, t in moments[1:-1]:
            passed = (seconds - begin) / dt
            steps = math.floor(passed + NEGLIGIBLE + passed * _ROUNDING)
            if passed - steps <= NEGLIGIBLE + passed * _ROUNDING:
                advance(steps)
                self.store(seconds, t)
                continue
            if between is None or done <= steps:
                advance(steps)
                before = self.state.arrays()
                advance(steps + 1)
                length_of_step = dt if steps < whole else rest
                between = origin + steps * dt, length_of_step, before, self.state.arrays()
            self._keep(seconds, t, *interpolated(t, self.state.scenes, *between), ahead=True)
        advance(whole + last)
        if stored:
            self.store(*moments[-1])

    def advance(self, steps: int, dt: float) -> None:
        """Take `steps` steps of `dt`. Members of a batch that fail stop; the others go on."""
        core = self.state.core
        while steps > 0 and self.live:
            done, failure = min(steps, self._limit), None
            before, begin = core.time, time.perf_counter()
            self.state.judge.steps_before = self.steps
            try:
                self.state.advance(done, dt)
            except BaseException as error:
                done = round((core.time - before) / dt)
                if not isinstance(error, (UnstableError, ContactError)) or error.member is None:
                    raise
                failure = error
            finally:
                self._count(done, begin)
            if failure is not None:
                self._leave(failure)
            steps -= done
            self._passed(core.time)

    def _leave(self, error: Any) -> None:
        """Leave the member behind that failed; its run ends with its present state."""
        member = error.member
        if self._ahead:
            t = self.state.core.time
            self._frames[member].put(t - self.job.start, t, error.x, error.v)
        self.failed[member] = error, self._trajectories([member])[member]
        self.live.remove(member)
        self.state.core.set_frozen(member, True)

    # Error control

    def _control(self, path: _core.AdaptiveRun) -> None:
        """Take steps at the tolerance of the job.

        Steps end where a piece of a motion ends. In reach of a sphere they are at most half as long
        as is guaranteed to be stable for this method and for rk4. Frames that are counted in steps
        are ends of accepted steps. Dense output gives other frames until a sphere responds, and
        from then on the polynomial of `interpolated`.
        """
        core, count = self.state.core, self.job.frames.steps
        since = self._earlier.steps % count if count else 0  # steps since the last frame
        for seconds, until in self.moments[1:]:
            while core.time < until:
                before, begin = path.steps, time.perf_counter()
                self.state.judge.steps_before = self.steps
                most = min(self._limit, count - since) if count else self._limit
                try:
                    events = core.advance_adaptive(path, until, most, self.state.threads)
                finally:
                    self._count(path.steps - before, begin)
                self._passed(min(core.time, until))
                if events:
                    self.state.judge.report(events, path.controller[0])
                if path.steps == before:
                    break  # what is left is rounding of the clock
                since += path.steps - before
                if since == count and core.time < until:
                    self.store(core.time - self.job.start, core.time)
                    since = 0
            if core.time <= until:
                self.store(seconds, until)
            elif not core.watched[0]["responded"]:
                self._keep(seconds, until, *self._dense(until), ahead=True)
            else:
                length = core.time - path.begin
                step = path.begin, length, self._dense(path.begin), self.state.arrays()
                self._keep(
                    seconds, until, *interpolated(until, self.state.scenes, *step), ahead=True
                )

    def _new_path(self) -> _core.AdaptiveRun:
        job, state, before = self.job, self.state, self._earlier
        stable = stable_dt(job.scene, job.options.integrator)
        # The law of contact is of order 1 in the step, so a method that takes long steps is no
        # better there.
        near = min(stable, stable_dt(job.scene)) / 2
        if before.control is None:
            stiffness, damping = _core.mode_bounds(job.scene.cloth.core, job.scene.core_forces)
            rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / job.duration)
            if job.options.integrator == "rkc2" and damping > 0:
                # Faster motion is damped at once, and so follows the slower.
                rate = min(rate, max(stiffness / damping, 1.0 / job.duration))
            tolerance, controller = (
                job.tolerance,
                (min(job.duration, 0.9 * stable), *_NEW_CONTROLLER),
            )
        else:
            tolerance, rate, controller = before.control
        self._control_values = tolerance, rate
        state.core.set_watch(_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES, job.duration / _SAMPLES)
        begin, end = self.moments[0][1], self.moments[-1][1]
        stops = {*stops_of(job.scene, begin, end), end}
        # Steps that are given are accepted at any finite error.
        self._unit = unit = _ANY_ERROR * tolerance if job.grid else tolerance
        return _core.AdaptiveRun(unit, unit * rate, near, sorted(stops), list(job.grid), controller)

    def _dense(self, t: float) -> Pair:
        """Positions and velocities at a time `t` in the last step, without responses at its end."""
        begin = time.perf_counter()
        x, v = np.empty(self.state.shape), np.empty(self.state.shape)
        self.state.core.dense(t, x, v, self.state.threads)
        self._wall_time += time.perf_counter() - begin
        return x, v

    # Both

    @property
    def _limit(self) -> int:
        """Steps of one call of the core: all, unless somebody waits for them."""
        return self._chunk if self._watch.bar is not None or self._pause else 1 << 60

    def _passed(self, t: float) -> None:
        self._watch.passed(t - self.job.start)
        if self._pause:
            self._pause()

    def _count(self, steps: int, begin: float) -> None:
        seconds = time.perf_counter() - begin
        self.steps += steps
        self._ahead |= steps > 0
        self._wall_time += seconds / len(self.live)
        wanted = _SECONDS_BETWEEN_SHOWS * steps / max(seconds, 1e-9)
        self._chunk = int(min(max(1.0, wanted), 2.0 * self._chunk))

    def store(self, seconds: float, t: float) -> None:
        """Store the state at the time `t`; `seconds` counts from the start of the run."""
        x, v = self.state.arrays()
        self.state.core.sample()
        self._keep(seconds, t, x, v, ahead=False)

    def _keep(self, seconds: float, t: float, x: Floats, v: Floats, ahead: bool) -> None:
        self._put(seconds, t, x, v)
        if self._watch.recorder is not self:  # until then the recorder before has the frames
            self._watch.begin(self, seconds)
        self._ahead = ahead
        self._watch.frame(t, x, v)

    def _put(self, seconds: float, t: float, x: Floats, v: Floats) -> None:
        x, v = (x, v) if self.state.batched else (x[None], v[None])
        for k in self.live:
            self._frames[k].put(seconds, t, x[k], v[k])

    def end_here(self) -> None:
        """End the run with its present state as the last frame."""
        if self._ahead:
            t = self.state.core.time
            self._put(t - self.job.start, t, *self.state.arrays())

    def trajectory(self) -> Trajectory:
        return self._trajectories([0])[0]

    def trajectories(self) -> list[Trajectory]:
        """The runs so far; that of a member that failed ends with its last good state."""
        found = self._trajectories(self.live) | {k: run for k, (_, run) in self.failed.items()}
        return [found[k] for k in range(len(self._frames))]

    def _trajectories(self, members: Sequence[int]) -> dict[int, Trajectory]:
        job, state, path, earlier = self.job, self.state, self._path, self._earlier
        watched, counted = state.core.watched, state.core.evaluations
        saves = state.batched and not job.own_step
        saved = of_members(state.core.snapshot(), state.scenes) if saves else [None] * len(watched)
        control = (*self._control_values, path.controller) if path else earlier.control
        method = METHODS[job.options.integrator]
        found = {}
        for k in members:
            frames = self._frames[k]
            frames.resize(len(frames.t))
            length = frames.t[-1] - frames.t[0]
            step = length / max(self.steps, 1) if job.dt is None else min(job.dt, length or job.dt)
            # The core does not count for kernels that take whole steps.
            evaluations = method.stages * self.steps if method.in_kernels else counted[k]
            settings = Continuation(
                job.start,
                frames.seconds,
                earlier.steps + self.steps,
                job.dt,
                job.frames,
                control,
                job.force is not None,
            )
            found[k] = Trajectory(
                scene=job.scenes[k],
                options=job.options,
                t=frames.t,
                x=frames.x,
                v=frames.v,
                steps=self.steps,
                rejected=path.rejected if path else 0,
                evaluations=evaluations,
                wall_time=self._wall_time,
                step=step,
                watched=watched[k],
                state=state,
                saved=saved[k],
                continuation=settings,
            )
        if path:
            one = found[0]
            one.tolerance, one.ends, one.kinks = job.tolerance, path.ends, path.kinks
            one.local_error = self._unit * path.local_error
        return found


def interpolated(
    t: float, scenes: Sequence[Scene], begin: float, h: float, before: Pair, after: Pair
) -> Pair:
    """The state of a cloth or a batch at a time `t` within a step.

    Positions are the cubic Hermite polynomial of positions and velocities, of order 4 in the time
    step where no sphere responds. Velocities are its derivative, of order 3. Driven pins are where
    their motion has them. Points are no deeper in a sphere than in the deeper of the two states.
    """
    (x0, v0), (x1, v1) = before, after
    s = (t - begin) / h
    x = x0 + s * (
        h * v0 + s * (3 * (x1 - x0) - h * (2 * v0 + v1) + s * (2 * (x0 - x1) + h * (v0 + v1)))
    )
    v = v0 + s * (6 * (x1 - x0) / h - 2 * (2 * v0 + v1) + 3 * s * (2 * (x0 - x1) / h + v0 + v1))
    put_driven_pins(scenes, x, v, t)
    for k, scene in enumerate(scenes):
        member = k if x.ndim == 4 else ...
        for sphere in scene.spheres:
            if sphere.response == "penalty":
                continue
            ends = ((begin, x0[member]), (begin + h, x1[member]))
            offset = sphere.offset_length(scene.cloth)
            _lift(x[member], ends, ~scene.cloth.pinned, sphere, offset, t)
    return x, v


def _lift(
    x: Floats,
    ends: Any,
    free: npt.NDArray[np.bool_],
    sphere: Sphere | Plane,
    offset: float,
    t: float,
) -> None:
    """Lift free points to their lesser height at both ends where it is below the contact offset."""
    height = sphere.height(x, t)
    least = np.minimum(*(sphere.height(places, time) for time, places in ends))
    allowed = np.minimum(least, offset)
    inside = free & (height < allowed)
    inside &= height > -sphere.radius
    x[inside] = sphere._at_height(x[inside], t, height[inside], allowed[inside])
