"""Recording of a run, or of the runs of a batch: frames and counts so far, its callback and its progress bar."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from ..base import Floats, check
from ..base.interrupts import Interrupts
from ..base.progress import ProgressBar
from ..engine.options import Options
from ..engine.snapshot import of_members
from ..engine.state import State
from ..errors import ContactError, RunInterrupted, UnstableError
from ..methods.data import METHODS
from .between import Step, interpolated
from .frames import NEGLIGIBLE, Schedule

Callback = Callable[[float, Floats, Floats], Any]
Frame = tuple[Floats, Floats]  # positions and velocities
# The tolerance of a step [m], the weight of velocities in it [1/s] and the state of the core's controller.
ControlValues = tuple[float, float, tuple[float, float, bool]]

# Called between steps; may raise to end a run, as for a sweep whose runs are on threads that Ctrl-C does not reach.
PAUSE: ContextVar[Callable[[], None] | None] = ContextVar("PAUSE", default=None)

_SECONDS_BETWEEN_SHOWS = 0.1  # of the progress bar, and between two pauses
_BYTES_AT_ONCE = 2**26


def progress_bar(shown: bool, duration: float) -> ProgressBar:
    """A progress bar of simulated seconds."""
    form = "{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"
    return ProgressBar(shown, total=duration, bar_format=form)


class StopRun(Exception):
    """Raised to end a run that the callback stops."""


def interrupted(so_far: Callable[[], Any]) -> NoReturn:
    """Raise RunInterrupted with the run so far. A second Ctrl-C is held back meanwhile, or begins this again."""
    while True:
        try:
            with Interrupts():
                raise RunInterrupted(so_far()) from None
        except RunInterrupted:
            raise
        except KeyboardInterrupt:
            continue


class Watch:
    """Follows the runs of one call of `simulate`.

    `callback` is called with (t, x, v) at each frame, and stops the run by returning True. `bar` is a bar of tqdm that
    counts simulated seconds. `recording` is the present run, or the last run that ended. `failed`: the callback has ended
    with an exception, or is at work.
    """

    def __init__(self, callback: Callback | None = None, bar: Any = None) -> None:
        self._callback, self.bar = callback, bar
        self._here = 0.0
        self.recording: Recording | None = None
        self.failed = False

    def begin(self, recording: Recording, seconds: float) -> None:
        """Follow a run from `seconds` after its start."""
        self.recording = recording
        self._here = seconds
        if self.bar is not None:
            self.bar.reset()

    def passed(self, seconds: float) -> None:
        """Show the first `seconds` of the run as done."""
        if self.bar is not None:
            self.bar.update(seconds - self._here)
            self._here = seconds

    def frame(self, t: float, x: Floats, v: Floats) -> None:
        """Call the callback; StopRun if it returns True."""
        if self._callback is None:
            return
        copies = [np.frombuffer(values.tobytes()).reshape(values.shape) for values in (x, v)]  # bytes never change
        self.failed = True
        stop = self._callback(t, *copies)
        if stop is not None and not isinstance(stop, (bool, np.bool_)):
            raise TypeError(f"callback must return True to stop the run, or False or None to go on, got {check.shown(stop)}")
        self.failed = False
        if stop:
            raise StopRun


@dataclass(frozen=True)
class Continuation:
    """The settings of a run, for its continuation."""

    start: float  # time of the start [s]
    seconds: float = 0.0  # duration of the run so far
    steps: int = 0  # since the start
    dt: float | None = None  # time step [s]; None with error control
    frames: Schedule = Schedule()
    control: ControlValues | None = None  # with error control

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Continuation:
        """Of plain data, whose values are converted: a file may hold any."""
        frames = {**data["frames"], "times": tuple(data["frames"]["times"])}
        dt, control = data["dt"], data["control"]
        if control is not None:
            control = (*map(float, control[:2]), (float(control[2][0]), float(control[2][1]), bool(control[2][2])))
        numbers = {"start": float(data["start"]), "seconds": float(data["seconds"]), "steps": int(data["steps"])}
        dt = None if dt is None else float(dt)
        return cls(**{**data, **numbers, "dt": dt, "frames": Schedule(**frames), "control": control})


@dataclass
class Steps:
    """The steps of a run with error control: its grid in time, and its local errors."""

    tolerance: float = math.nan  # of a step [m], where the run has chosen them
    ends: list[float] = field(default_factory=list)  # times of the scene [s]
    kinks: list[int] = field(default_factory=list)  # steps before each kink of a motion
    local_error: float = 0.0  # sum of the method's own estimates of the steps' errors [m]

    def refined(self, start: float, ratio: float) -> list[float]:
        """Ends of a grid with `ratio` times as many steps between two kinks. Time is interpolated over the step number."""
        ends, finer = [start, *self.ends], []
        for first, last in pairwise([0, *self.kinks, len(self.ends)]):
            count = last - first
            numbers = np.linspace(0, count, max(count + 1, math.ceil(ratio * count - NEGLIGIBLE)) + 1)[1:]
            finer += np.interp(numbers, np.arange(count + 1), ends[first : last + 1]).tolist()
        return finer


def force_evaluations(options: Options, steps: int, counted: int) -> int:
    """Force evaluations of so many steps; `counted` by the core, which does not for kernels that take whole steps."""
    method = METHODS[options.integrator]
    return method.stages * steps if method.in_kernels else counted


@dataclass
class Solution:
    """Frames of one run and its cost. `saved`: the fields of the core for a member of a batch, which `state` steps."""

    options: Any
    t: list[float]
    x: Floats
    v: Floats
    steps: int
    rejected: int
    evaluations: int
    wall_time: float  # of stepping [s]
    watched: Mapping[str, Any]  # by the core, see watched.hpp
    step: float  # fixed: the time step, adaptive: the mean one [s]
    state: State
    continuation: Continuation | None = None
    grid: Steps = field(default_factory=Steps)  # with error control
    saved: dict[str, Any] | None = None

    @property
    def contacts(self) -> bool:
        """Whether a sphere has responded."""
        return bool(self.watched["in_contact"])


class _Frames:
    """Frames of a cloth, stacked as they come: to stack thousands of them at the end would hold back Ctrl-C."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.t: list[float] = []
        self.seconds = 0.0  # of the last frame, since the start of the run
        self.x: Floats = np.empty((1, *shape))
        self.v: Floats = np.empty((1, *shape))

    def put(self, seconds: float, t: float, x: Floats, v: Floats) -> None:
        """Add a frame."""
        k = len(self.t)
        if k == min(len(self.x), len(self.v)):
            # The system moves pages, not bytes; numpy fills the new ones. Half of the part or of the bytes: twice as
            # often. Twice: memory for a quarter more frames, or Ctrl-C later by another 0.03 s.
            self.resize(k + 1 + min(k // 8, _BYTES_AT_ONCE // x.nbytes))
        self.x[k], self.v[k] = x, v
        self.seconds = seconds
        self.t.append(t)  # last: a frame counts from here on

    def resize(self, count: int) -> None:
        """Make room for so many frames."""
        for stack in (self.x, self.v):
            if count != len(stack):
                stack.resize((count, *stack.shape[1:]), refcheck=False)


class Recording:
    """A run in progress, or the runs of a batch, which advances `state`.

    `dt` [s] is None with error control, which has `control` instead. The duration of the `earlier` part of the run is 0 if
    there is none. `steps` and `rejected` count accepted and rejected steps. `wall_time` [s] is that of stepping and dense
    output; of a batch, the share of a member. `live` has the members of the batch that go on, and `failed` each other's
    error, with the run so far.
    """

    def __init__(
        self,
        state: State,
        options: Any,
        watch: Watch,
        dt: float | None,
        frames: Schedule = Schedule(),  # noqa: B008  # frozen
        earlier: Continuation = Continuation(0.0),
        control: Callable[[], ControlValues] | None = None,
    ) -> None:
        self.state, self.options, self.dt = state, options, dt
        self._schedule, self._earlier, self._control = frames, earlier, control
        self.saves = True  # whether the runs of a batch have their snapshots
        self.steps = self.rejected = 0
        self.wall_time = 0.0
        self._watch, self._start = watch, earlier.start
        self._frames = [_Frames(state.shape[-3:]) for _ in state.scenes]
        self.live = list(range(len(state.scenes)))
        self.failed: dict[int, tuple[UnstableError | ContactError, Solution]] = {}
        self._steps_at_frame = 0
        self._ahead = False  # the present state comes after the last frame, which is interpolated
        self._watched: Sequence[Mapping[str, Any]] = ()
        self._chunk, self._pause = 1, PAUSE.get()
        self.store(earlier.seconds, self._start + earlier.seconds)

    def advance(self, steps: int, dt: float) -> None:
        """Take `steps` steps of `dt`. A member of a batch that fails is left behind."""
        while steps > 0 and self.live:
            steps -= self._advance(min(steps, self._chunk) if self._watch.bar is not None or self._pause else steps, dt)
            self._passed(self.state.core.time)

    def _advance(self, steps: int, dt: float) -> int:
        """Take at most so many steps; the number taken."""
        core = self.state.core
        before, begin = core.time, time.perf_counter()
        self.state.judge.steps_before = self.steps
        done, failure = steps, None
        try:
            self.state.advance(steps, dt)
        except BaseException as error:
            done = round((core.time - before) / dt)
            if not isinstance(error, (UnstableError, ContactError)) or error.member is None:
                raise
            failure = error
        finally:
            self.steps += done
            self._count(done, begin)
        if failure is not None:
            self._leave(failure)
        return done

    def _leave(self, error: Any) -> None:
        """Leave the member behind that failed; its run ends with its present state."""
        member = error.member
        if self.steps > self._steps_at_frame or self._ahead:
            t = self.state.core.time
            self._frames[member].put(t - self._start, t, error.x, error.v)
        self.failed[member] = error, self._solutions([member])[member]
        self.live.remove(member)
        self.state.core.set_frozen(member, True)

    def advance_adaptive(self, until: float, end: float, *arguments: Any) -> dict[str, Any]:
        """A step with error control towards a time [s], up to `end`; the outcome."""
        begin = time.perf_counter()
        self.state.judge.steps_before = self.steps
        outcome = self.state.core.advance_adaptive(until, end, 1, *arguments)
        self.steps += outcome["steps"]
        self.rejected += outcome["rejected"]
        self._count(outcome["steps"], begin)
        self._passed(min(self.state.core.time, until))
        if "interrupted" in outcome:
            raise outcome["interrupted"]
        return outcome

    def _passed(self, t: float) -> None:
        self._watch.passed(t - self._start)
        if self._pause:
            self._pause()

    def _count(self, steps: int, begin: float) -> None:
        seconds = time.perf_counter() - begin
        self.wall_time += seconds / len(self.live)
        wanted = _SECONDS_BETWEEN_SHOWS * steps / max(seconds, 1e-9)
        self._chunk = int(min(max(1.0, wanted), 2.0 * self._chunk))

    def store(self, seconds: float, t: float) -> None:
        """Store the state at the time `t`; `seconds` counts from the start of the run."""
        x, v = self.arrays_now()
        self.state.core.sample()
        self._keep(seconds, t, x, v, ahead=False)

    def arrays_now(self) -> Frame:
        """Positions and velocities of the present state."""
        x, v = np.empty(self.state.shape), np.empty(self.state.shape)
        self.state.store(x, v)
        return x, v

    def store_between(self, seconds: float, t: float, step: Step) -> None:
        """Store a frame within a step that ends at the present state."""
        self._keep(seconds, t, *interpolated(t, self.state.scenes, *step), ahead=True)

    def store_dense(self, seconds: float, t: float) -> None:
        """Store the state at a time `t` within the last step, before any contact."""
        self._keep(seconds, t, *self.dense(t), ahead=True)

    def dense(self, t: float) -> Frame:
        """Positions and velocities at a time `t` within the last step, without responses at its end."""
        begin = time.perf_counter()
        x, v = np.empty(self.state.shape), np.empty(self.state.shape)
        self.state.core.dense(t, x, v, self.state.threads)
        self.wall_time += time.perf_counter() - begin
        return x, v

    def _keep(self, seconds: float, t: float, x: Floats, v: Floats, ahead: bool) -> None:
        self._put(seconds, t, x, v)
        if self._watch.recording is not self:  # until then the recording before has the frames
            self._watch.begin(self, seconds)
        self._steps_at_frame, self._ahead = self.steps, ahead
        self._watch.frame(t, x, v)

    def _put(self, seconds: float, t: float, x: Floats, v: Floats) -> None:
        x, v = (x, v) if self.state.batched else (x[None], v[None])
        for k in self.live:
            self._frames[k].put(seconds, t, x[k], v[k])

    def end_here(self) -> None:
        """End the run with its present state as the last frame."""
        if self.steps > self._steps_at_frame or self._ahead:
            t = self.state.core.time
            self._put(t - self._start, t, *self.arrays_now())

    def end_at_frame(self) -> None:
        """End the run with the last frame. With fixed steps the present state follows an interpolated frame."""
        if self.dt is not None:
            self.end_here()
        elif self._ahead:
            self._watched = self.state.core.watched  # a state that is loaded is watched anew
            frames, last = self._frames[0], len(self._frames[0].t) - 1
            self.state.core.load(frames.x[last], frames.v[last])
            self.state.core.time = frames.t[-1]

    def solution(self, grid: Steps | None = None) -> Solution:
        """The run so far; `grid`: its steps, with error control."""
        return self._solutions([0], grid)[0]

    def solutions(self) -> list[Solution]:
        """The runs so far; that of a member that failed ends with its last good state."""
        found = self._solutions(self.live) | {k: run for k, (_, run) in self.failed.items()}
        return [found[k] for k in range(len(self._frames))]

    def _solutions(self, members: Iterable[int], grid: Steps | None = None) -> dict[int, Solution]:
        state, options, dt = self.state, self.options, self.dt
        watched, counted = self._watched or state.core.watched, state.core.evaluations
        saved = of_members(state.core.snapshot(), state.scenes) if state.batched and self.saves else [None] * len(watched)
        control = self._control() if self._control else self._earlier.control
        found = {}
        for k in members:
            frames = self._frames[k]
            frames.resize(len(frames.t))
            length = frames.t[-1] - frames.t[0]
            step = length / max(self.steps, 1) if dt is None else min(dt, length or dt)
            before = self._earlier.steps + self.steps
            settings = Continuation(self._start, frames.seconds, before, dt, self._schedule, control)
            cost = self.steps, self.rejected, force_evaluations(options, self.steps, counted[k]), self.wall_time
            rest = watched[k], step, state, settings, grid or Steps(), saved[k]
            values: tuple[Any, ...] = options, frames.t, frames.x, frames.v, *cost, *rest
            found[k] = Solution(*values)
        return found
