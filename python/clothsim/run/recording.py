"""Recording of a run: its frames and counts so far, its callback and its progress bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from typing import Any, NoReturn

import numpy as np

from ..base import Floats, check
from ..base.interrupts import Interrupts
from ..base.progress import ProgressBar
from ..engine.state import State
from ..errors import RunInterrupted
from .between import Ends
from .frames import Schedule

Callback = Callable[[float, Floats, Floats], Any]
Frame = tuple[Floats, Floats]  # positions and velocities
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
        self._callback, self._bar = callback, bar
        self._here = 0.0
        self.recording: Recording | None = None
        self.failed = False

    def begin(self, recording: Recording, seconds: float) -> None:
        """Follow a run from `seconds` after its start."""
        self.recording = recording
        self._here = seconds
        if self._bar is not None:
            self._bar.reset()

    @property
    def shows(self) -> bool:
        """Whether a progress bar has to be kept up to date."""
        return self._bar is not None

    def passed(self, seconds: float) -> None:
        """Show the first `seconds` of the run as done."""
        if self._bar is not None:
            self._bar.update(seconds - self._here)
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


class Control:
    """Values beside the state that determine the next steps of a run with error control.

    The tolerance of a step [m], the weight `rate` of velocities in it [1/s] and the core's controller.
    """

    def __init__(self, tolerance: float, rate: float, controller: Any) -> None:
        self._fixed, self._controller = (tolerance, rate), controller

    @property
    def values(self) -> ControlValues:
        return (*self._fixed, self._controller.state)


@dataclass(frozen=True)
class Continuation:
    """The settings of a run, for its continuation."""

    start: float  # time of the start [s]
    seconds: float = 0.0  # duration of the run so far
    steps: int = 0  # since the start
    dt: float | None = None  # time step [s]; None with error control
    frames: Schedule = Schedule()
    control: ControlValues | None = None  # of `Control`, with error control

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


class _Frames:
    """Arrays of one shape, stacked as they come: to stack thousands of them at the end would hold back Ctrl-C."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._stacked: Floats = np.empty((1, *shape))

    def put(self, k: int, values: Floats) -> None:
        """Let `values` be the array k, the next one."""
        if k == len(self._stacked):
            # The system moves pages, not bytes; numpy fills the new ones. Half of the part or of the bytes: twice as
            # often. Twice: memory for a quarter more frames, or Ctrl-C later by another 0.03 s.
            self._resize(k + 1 + min(k // 8, _BYTES_AT_ONCE // values.nbytes))
        self._stacked[k] = values

    def stacked(self, count: int) -> Floats:
        """The first `count` arrays, which are then all."""
        self._resize(count)
        return self._stacked

    def __getitem__(self, k: int) -> Floats:
        found: Floats = self._stacked[k]
        return found

    def _resize(self, count: int) -> None:
        if count != len(self._stacked):
            self._stacked.resize((count, *self._stacked.shape[1:]), refcheck=False)


class Recording:
    """A run in progress, which advances `state`.

    `dt` [s] is None with error control, which has `control` instead. The duration of the `earlier` part of the run is 0 if
    there is none. `t` has the times of the frames [s]. `steps` and `rejected` count accepted and rejected steps.
    `wall_time` [s] is that of stepping and dense output.
    """

    def __init__(
        self,
        state: State,
        options: Any,
        watch: Watch,
        dt: float | None,
        frames: Schedule = Schedule(),  # noqa: B008  # frozen
        earlier: Continuation = Continuation(0.0),
        control: Control | None = None,
    ) -> None:
        self.state, self.options, self.dt = state, options, dt
        self._frames, self._earlier, self._control = frames, earlier, control
        self.t: list[float] = []
        self.steps = self.rejected = 0
        self.wall_time = 0.0
        self._watch, self._start = watch, earlier.start
        self._x, self._v = _Frames(state.shape), _Frames(state.shape)
        self._steps_at_frame = 0
        self._ahead = False  # the present state comes after the last frame, which is interpolated
        self._watched: Mapping[str, Any] = {}
        self._chunk, self._pause = 1, PAUSE.get()
        self.store(earlier.seconds, self._start + earlier.seconds)

    def advance(self, steps: int, dt: float) -> None:
        """Take `steps` steps of `dt`."""
        while steps > 0:
            chunk = min(steps, self._chunk) if self._watch.shows or self._pause else steps
            self._advance(chunk, dt)
            self._passed(self.state.core.time)
            steps -= chunk

    def _advance(self, steps: int, dt: float) -> None:
        core = self.state.core
        before, begin = core.time, time.perf_counter()
        self.state.judge.steps_before = self.steps
        done = steps
        try:
            self.state.advance(steps, dt)
        except BaseException:
            done = round((core.time - before) / dt)
            raise
        finally:
            self.steps += done
            self._count(done, begin)

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
        self.wall_time += seconds
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

    def store_between(self, seconds: float, t: float, ends: Ends) -> None:
        """Store a frame between two steps, the last of which ends at the present state."""
        self._keep(seconds, t, *ends.at(t, self.state.scenes[0]), ahead=True)

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
        self._put(t, x, v)
        if len(self.t) == 1:  # until then the recording before has the frames
            self._watch.begin(self, seconds)
        self._steps_at_frame, self._ahead, self._seconds = self.steps, ahead, seconds
        self._watch.frame(t, x, v)

    def _put(self, t: float, x: Floats, v: Floats) -> None:
        self._x.put(len(self.t), x)
        self._v.put(len(self.t), v)
        self.t.append(t)  # last: a frame counts from here on

    @property
    def watched(self) -> Mapping[str, Any]:
        """Extremes of all states, by the core."""
        return self._watched or self.state.core.watched[0]

    def end_here(self) -> None:
        """End the run with its present state as the last frame."""
        if self.steps > self._steps_at_frame or self._ahead:
            self._put(self.state.core.time, *self.arrays_now())
            self._seconds = self.state.core.time - self._start

    def end_at_frame(self) -> None:
        """End the run with the last frame. With fixed steps the present state follows an interpolated frame."""
        if self.dt is not None:
            self.end_here()
        elif self._ahead:
            self._watched = self.watched  # a state that is loaded is watched anew
            last = len(self.t) - 1
            self.state.core.load(self._x[last], self._v[last])
            self.state.core.time = self.t[-1]

    @property
    def continuation(self) -> Continuation:
        """The settings for a continuation from the last frame."""
        control = self._control.values if self._control else self._earlier.control
        steps = self._earlier.steps + self.steps
        return Continuation(self._start, self._seconds, steps, self.dt, self._frames, control)

    def arrays(self) -> Frame:
        """Positions and velocities of all frames, at the end of the run."""
        return self._x.stacked(len(self.t)), self._v.stacked(len(self.t))
