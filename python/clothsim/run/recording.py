"""A job in progress, of a scene or of the scenes of a batch side by side.

Fixed steps and error control go one way: the core takes the steps and fills the frames. Frames
never change a run: a frame between two steps is interpolated (cpp/driver/frames.hpp).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from itertools import pairwise
from typing import Any

import numpy as np

from .. import _core
from ..base import Floats, check
from ..engine.force import force_of_each_scene
from ..engine.judge import TIME_STEP
from ..engine.snapshot import fields_of_members
from ..engine.state import State
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..methods.integrators import METHODS
from ..model.scene import turning_times
from .frames import NEGLIGIBLE
from .trajectory import Continuation, Job, Trajectory

Callback = Callable[[float, Floats, Floats], Any]
Failure = UnstableError | ContactError

# This is called between steps. It may raise to end a run, as for a sweep whose runs are on threads
# that Ctrl-C does not reach.
PAUSE: ContextVar[Callable[[], None] | None] = ContextVar("PAUSE", default=None)

_SECONDS_BETWEEN_SHOWS = 0.1  # of the progress bar, and between two pauses
# Velocities are weighed against positions by a frequency above all of the cloth: this many times
# the bound on its frequencies. Errors of x then decide, and those of v are held to the same scale.
_VELOCITY_WEIGHT = 3.0
_ANY_ERROR = 1e12  # largest error of a step of a prescribed grid, over its tolerance
# The error of the step before, and whether a step was rejected just now, of a new controller.
_NEW_CONTROLLER = 1e-4, False
_UNLIMITED = 1 << 60  # steps or frames
# A run samples triangles and stretches at so many states at least, and after so many steps at most.
# An adaptive method's steps are several times as long.
_SAMPLES = 32
_MOST_STEPS_BETWEEN_SAMPLES = 128
_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES = 16


class StopRun(Exception):
    """Raised to end a run that the callback stops."""


class Watch:
    """Follows the runs of one call of `simulate`.

    `callback` is called with (t, x, v) at each frame, and stops the run by returning True. `bar` is
    a bar of tqdm that counts simulated seconds. `recording` has the present run, or the last run
    that ended.
    """

    def __init__(self, callback: Callback | None = None, bar: Any = None) -> None:
        self._callback = callback
        self.bar = bar
        self._seconds = 0.0
        self.recording: Recording | None = None

    @property
    def waits_for_frames(self) -> bool:
        return self._callback is not None

    def begin_run(self, recording: Recording, seconds: float) -> None:
        """Start to follow a run whose first state is `seconds` after its start."""
        self.recording = recording
        self._seconds = seconds
        if self.bar is not None:
            self.bar.reset()

    def show_progress(self, seconds: float) -> None:
        """Move the bar to a time since the start of the run [s]."""
        if self.bar is not None:
            self.bar.update(seconds - self._seconds)
            self._seconds = seconds

    def pass_frame(self, t: float, x: Floats, v: Floats) -> None:
        if self._callback is None:
            return
        stop = self._callback(t, *map(_read_only_copy, (x, v)))
        if stop is not None and not isinstance(stop, (bool, np.bool_)):
            raise TypeError(
                "callback must return True to stop the run, or False or None to go on, got "
                f"{check.value_text(stop)}"
            )
        if stop:
            raise StopRun


def _read_only_copy(values: Floats) -> Floats:
    """Return a copy that nobody can change."""
    return np.frombuffer(values.tobytes()).reshape(values.shape)


def _count_equal_steps(begin: float, end: float, dt: float, longest: float) -> int:
    """Return how many equal steps of at most `dt` there are: so many parts of each of the longest,
    so that a shorter step is shorter between all kinks.
    """
    if not longest < math.inf:
        longest = dt
    count = math.ceil((end - begin) / longest - NEGLIGIBLE)
    return count * math.ceil(longest / dt - NEGLIGIBLE)


def equal_steps(stops: Sequence[_core.Moment], counts: Sequence[int]) -> list[_core.Segment]:
    """Return so many equal steps between each two of the stops."""
    return [
        _core.Segment(begin=a, end=b, dt=(b.time - a.time) / count, whole=count)
        for (a, b), count in zip(pairwise(stops), counts, strict=True)
    ]


class Recording:
    """A job in progress: the core advances `state` and fills the frames of its members.

    `live` has the members of a batch that go on, `failed` the error and the run so far of each
    other member.
    """

    def __init__(self, job: Job, watch: Watch, quiet: frozenset[str] = frozenset()) -> None:
        self.job = job
        self._watch = watch
        forces = force_of_each_scene(job.force, job.scenes, job.batched)
        if job.own_step or job.dt is None:
            quiet |= TIME_STEP
        self.state = State.from_scenes(
            job.scenes, job.batched, job.start, job.options, forces, quiet
        )
        self._earlier = Continuation(job.start)
        if job.resumed:
            snapshot, self._earlier = job.resumed
            core = {
                name: 0 * value if name in ("impulses", "contacts") else value
                for name, value in snapshot.core.items()
            }
            self.state.core.restore(core)  # a report has the impulses of its own run
        begin = self._earlier.seconds
        moments = job.frames.moments_between(job.start, begin, begin + job.duration, job.dt)
        self._end = moments[-1]
        self._path = (
            self._plan_adaptive_steps(moments)
            if job.dt is None
            else self._plan_fixed_steps(moments, job.dt)
        )
        shape = (len(moments), *self.state.shape[-3:])
        self._x = [np.empty(shape) for _ in job.scenes]
        self._v = [np.empty(shape) for _ in job.scenes]
        self._wall_time = 0.0  # of steps and frames [s]; of a batch, the share of a member
        self.live = list(range(len(job.scenes)))
        self.failed: dict[int, tuple[Failure, Trajectory]] = {}
        self._chunk = 1
        self._pause = PAUSE.get()

    def run_to_end(self) -> Recording:
        if self.job.dt is not None:
            self.state.warn_of_time_step(self.job.dt)
        while self.live and not self._path.complete:
            # Nobody waits for a run without a bar and a pause.
            waits = self._watch.bar is not None or self._pause
            self._advance(self._chunk if waits else _UNLIMITED)
        return self

    def _plan_fixed_steps(self, moments: list[_core.Moment], dt: float) -> _core.FixedRun:
        """Return steps of `dt`; own steps are equal between kinks of motions, none within a step.

        The last step is shorter where the step does not divide the time.
        """
        job = self.job
        begin = moments[0]
        end = moments[-1]
        every = min(_MOST_STEPS_BETWEEN_SAMPLES, job.duration / dt // _SAMPLES)
        self.state.core.set_watch(int(max(1, every)), 0.0)
        kinks: set[float] = set()
        if job.own_step:
            for scene in job.scenes:
                kinks.update(turning_times(scene, begin.time, end.time))
        if not kinks:
            length = end.seconds - begin.seconds
            count = math.floor(length / dt + NEGLIGIBLE)
            rest = length - count * dt
            last = rest if rest > NEGLIGIBLE * dt else 0.0
            segment = _core.Segment(begin=begin, end=end, dt=dt, whole=count, rest=last)
            return _core.FixedRun([segment], moments)
        stops = [begin, *(_core.Moment(t - job.start, t) for t in sorted(kinks)), end]
        counts = [_count_equal_steps(a.time, b.time, dt, job.longest) for a, b in pairwise(stops)]
        if every := job.frames.steps_between:
            ends = [
                np.linspace(a.time, b.time, count + 1)[1:]
                for (a, b), count in zip(pairwise(stops), counts)
            ]
            times = np.concatenate(ends)[every - 1 : -1 : every].tolist()
            moments = [begin, *(_core.Moment(t - job.start, t) for t in times), end]
        return _core.FixedRun(equal_steps(stops, counts), moments)

    def _plan_adaptive_steps(self, moments: list[_core.Moment]) -> _core.AdaptiveRun:
        """Return steps at the tolerance of the job.

        They end where a piece of a motion ends. In reach of a sphere that responds after a step
        they are at most half as long as is guaranteed to be stable for this method and for rk4.
        """
        job = self.job
        state = self.state
        continuation = self._earlier
        stable = stable_dt(job.scene, job.options.integrator)
        # The law of contact is of order 1 in the step, so a method that takes long steps is no
        # better there.
        near = min(stable, stable_dt(job.scene)) / 2
        if continuation.control is None:
            stiffness, damping = _core.mode_bounds(job.scene.cloth.core, job.scene.core_forces)
            rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / job.duration)
            if job.options.integrator == "rkc2" and damping > 0:
                # Faster motion is damped at once, and so follows the slower.
                rate = min(rate, max(stiffness / damping, 1.0 / job.duration))
            tolerance = job.tolerance
            controller = (min(job.duration, 0.9 * stable), *_NEW_CONTROLLER)
        else:
            tolerance, rate, controller = continuation.control
        self._control_values = tolerance, rate
        state.core.set_watch(_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES, job.duration / _SAMPLES)
        end = moments[-1].time
        # Steps that are given are accepted at any finite error.
        self._unit = _ANY_ERROR * tolerance if job.grid else tolerance
        every = job.frames.steps_between
        return _core.AdaptiveRun(
            tolerance_x=self._unit,
            tolerance_v=self._unit * rate,
            near=near,
            stops=sorted({*turning_times(job.scene, moments[0].time, end), end}),
            grid=list(job.grid),
            controller=controller,
            moments=moments,
            start=job.start,
            every=every,
            since_frame=continuation.steps % every if every else 0,
        )

    def _advance(self, steps: int) -> None:
        """Take at most so many steps. Members of a batch that fail stop; the others go on."""
        path = self._path
        stored = path.stored
        steps_before = path.steps
        self._make_room_for_frames()
        failure = None
        begin = time.perf_counter()
        try:
            frames = 1 if self._watch.waits_for_frames else _UNLIMITED
            self.state.record(path, self._x, self._v, steps, frames)
        except (UnstableError, ContactError) as error:
            if error.member is None:
                raise
            failure = error
        finally:
            self._measure_speed(path.steps - steps_before, time.perf_counter() - begin)
            if path.stored and self._watch.recording is not self:  # until then the one before
                self._watch.begin_run(self, path.frame(0).seconds)
        if path.stored > stored:
            t = path.frame(stored).time
            self._watch.pass_frame(t, self._x[0][stored], self._v[0][stored])
        if failure is not None:
            self._end_failed_member(failure)
        self._watch.show_progress(min(self.state.core.time, self._end.time) - self.job.start)
        if self._pause:
            self._pause()

    def _make_room_for_frames(self) -> None:
        """Leave room for two frames where an adaptive run counts them in steps: nobody knows how
        many there will be.
        """
        if self.job.dt is not None or not self.job.frames.steps_between:
            return
        count = self._path.stored
        for stack in (*self._x, *self._v):
            if count + 2 > len(stack):
                stack.resize((count + 2 + count // 8, *stack.shape[1:]), refcheck=False)

    def _measure_speed(self, steps: int, seconds: float) -> None:
        self._wall_time += seconds / len(self.live)
        chunk = _SECONDS_BETWEEN_SHOWS * steps / max(seconds, 1e-9)
        self._chunk = int(min(max(1.0, chunk), 2.0 * self._chunk))

    def _end_failed_member(self, error: Any) -> None:
        """Leave the member behind that failed; its run ends with its present state."""
        member = error.member
        self.failed[member] = error, self._trajectories_so_far([member])[member]
        self.live.remove(member)
        self.state.core.set_frozen(member, True)

    def trajectory(self) -> Trajectory:
        return self.trajectories()[0]

    def trajectories(self) -> list[Trajectory]:
        """Return the runs so far, which end with the present state.

        That of a member that failed ends with its last good state.
        """
        runs = self._trajectories_so_far(self.live)
        runs |= {k: run for k, (_, run) in self.failed.items()}
        return [runs[k] for k in range(len(self.job.scenes))]

    def _trajectories_so_far(self, members: Sequence[int]) -> dict[int, Trajectory]:
        """Return runs of members so far, which end with the present state."""
        job = self.job
        state = self.state
        path = self._path
        moments = path.frames
        stored = len(moments)
        if path.ahead and not path.complete:
            t = state.core.time
            moments.append(_core.Moment(t - job.start, t))
            x, v = state.positions_and_velocities()
            for k in members:
                self._x[k][stored] = x[k] if state.batched else x
                self._v[k][stored] = v[k] if state.batched else v
        times = [moment.time for moment in moments]
        length = times[-1] - times[0]
        step = length / max(path.steps, 1) if job.dt is None else min(job.dt, length or job.dt)
        earlier = self._earlier
        control = earlier.control
        errors: dict[str, Any] = {"rejected": 0}
        if isinstance(path, _core.AdaptiveRun):
            control = (*self._control_values, path.controller)
            errors = {
                "rejected": path.rejected,
                "tolerance": job.tolerance,
                "ends": path.ends,
                "kinks": path.kinks,
                "local_error": self._unit * path.local_error,
            }
        continuation = Continuation(
            start=job.start,
            seconds=moments[-1].seconds,
            steps=earlier.steps + path.steps,
            dt=job.dt,
            frames=job.frames,
            control=control,
            forced=job.force is not None,
        )
        watched = state.core.watched
        counted = state.core.evaluations
        keeps = state.batched and not job.own_step
        saved = (
            fields_of_members(state.core.snapshot(), state.scenes)
            if keeps
            else [None] * len(watched)
        )
        method = METHODS[job.options.integrator]
        runs = {}
        for k in members:
            for stack in (self._x[k], self._v[k]):
                stack.resize((len(moments), *stack.shape[1:]), refcheck=False)
            runs[k] = Trajectory(
                scene=job.scenes[k],
                options=job.options,
                t=times,
                x=self._x[k],
                v=self._v[k],
                steps=path.steps,
                # The core does not count for kernels that take whole steps.
                evaluations=method.stages * path.steps if method.in_kernels else counted[k],
                wall_time=self._wall_time,
                step=step,
                watched=watched[k],
                state=state,
                saved=saved[k],
                continuation=continuation,
                **errors,
            )
        return runs
