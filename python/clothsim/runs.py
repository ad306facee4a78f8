"""One run of a scene, at a fixed time step or with error control, and what it cost."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from . import _core
from ._state import State
from .frames import NEGLIGIBLE, Floats, Schedule
from .integration import integrators
from .plan import core_cloth
from .recording import Continuation, Control, Frame, Recording, Watch
from .scene import Scene
from .snapshot import Snapshot
from .stability.bound import guaranteed_dt


class Observer(Protocol):
    """Is told of the steps of a run."""

    wall_time: float  # it took [s]

    def steps_at_once(self, t: float, dt: float, left: int) -> int:
        """Of `left` equal steps from t on, how many it may be told of as one."""

    def observe(
        self, t: float, before: Frame, after: Frame, dt: float, steps: int, estimate: float
    ) -> None:
        """The run went from `before` at t to `after` by so many steps of dt.

        `estimate`: the method's own of the error of a step, in any unit.
        """


# Velocities are weighed against positions by a frequency above all of the cloth: this many times
# the bound on its frequencies. Errors of x then decide, and those of v are held to the same scale.
_VELOCITY_WEIGHT = 3.0


def size_of(scene: Scene) -> float:
    """The longer side of the cloth [m]: what a relative tolerance is relative to."""
    return max(scene.cloth.size)


def rms(difference: Floats) -> float:
    """Root of the mean over mass points of the squared distance."""
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def perturbation(scene: Scene, size: float) -> Floats:
    """Random displacements of the points that are free, `size` [m] rms; the same every time."""
    free = ~scene.cloth.pinned[..., None]
    noise = np.random.default_rng(1).standard_normal(scene.initial_position.shape) * free
    return noise * (size / rms(noise)) if noise.any() else noise


@dataclass(frozen=True)
class Options:
    """How the steps are computed, as `step` takes it."""

    integrator: str
    precision: str
    threads: int | None
    kernel: str
    strict: bool
    backend: str = "cpu"
    sampling: int = 32  # states at which triangles and stretches are sampled, at least
    start: float = 0.0  # time of the initial state [s]

    def state(self, scene: Any, x: Any = None, v: Any = None, inspect: bool = True) -> State:
        return State(
            scene, x, v, t=self.start, inspect=inspect, integrator=self.integrator, precision=self.precision,
            threads=self.threads, kernel=self.kernel, strict=self.strict, backend=self.backend,
        )  # fmt: skip

    def replace(self, **changes: Any) -> Options:
        return Options(**{**self.__dict__, **changes})


# Between two states at which triangles and stretches are sampled. An adaptive method's steps are
# several times as long.
_MOST_STEPS_BETWEEN_SAMPLES = 128
_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES = 16


def sample_every(steps: float, sampling: int) -> int:
    """Steps between two sampled states of a run of so many steps, for `sampling` states at least."""
    return int(max(1, min(_MOST_STEPS_BETWEEN_SAMPLES, steps // sampling)))


@dataclass(frozen=True)
class Resumed:
    """A run that goes on: its final state, and how it was computed."""

    snapshot: Snapshot
    continuation: Continuation

    def state(self, scene: Scene, options: Options) -> State:
        state = options.state(scene, inspect=False)
        state.core.restore(*self.snapshot.core)
        return state


@dataclass
class Solution:
    """Frames of one run and what it cost."""

    options: Options
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

    @property
    def contacts(self) -> bool:
        """Whether a sphere has responded."""
        return bool(self.watched["in_contact"])

    @classmethod
    def of(cls, run: Recording) -> Solution:
        """The run as far as it has been recorded."""
        state, t, options = run.state, run.t, run.options
        fixed = options.integrator == "rk4"
        evaluations = 4 * run.steps if fixed else state.core.evaluations[0]
        step = (t[-1] - t[0]) / max(run.steps, 1) if run.dt is None else run.dt
        return cls(
            options, t, *run.arrays(), run.steps, run.rejected, evaluations, run.wall_time,
            run.watched, step, state, run.continuation,
        )  # fmt: skip


def integrate(
    scene: Scene,
    duration: float,
    tolerance: float,
    options: Options,
    frames: Schedule | None = None,
    watch: Watch | None = None,
    error: Observer | None = None,
    longest: float | None = None,
    resumed: Resumed | None = None,
) -> Solution:
    """One run with error control, at a tolerance per step [m].

    `frames`: those counted in steps are of accepted steps, the others come from dense output.
    `error`: is told of every step until a contact. `longest`: the first step, and none is longer
    [s]; at a tolerance that all steps meet they are equal. `resumed`: the run to go on from, which
    has set the tolerance and the longest step.
    """
    controller = _core.StepController()
    if resumed is None:
        state, earlier = options.state(scene), Continuation(options.start)
        stiffness, _ = core_cloth(scene).mode_bounds
        rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / duration)
        if longest is None:
            longest = duration
            controller.h = min(duration, 0.9 * guaranteed_dt(core_cloth(scene), options.integrator))
        else:
            # A hair more, so that what rounding leaves of the duration is not a step of its own.
            controller.h = longest = (1 + 1e-9) * longest
    else:
        state, earlier = resumed.state(scene, options), resumed.continuation
        assert earlier.control is not None
        tolerance, rate, longest, controller.state = earlier.control
    state.core.set_watch(_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES, duration / options.sampling)
    frames = frames or Schedule()
    start, count, begin, before = earlier.start, frames.steps, earlier.seconds, earlier.steps
    control = Control(tolerance, rate, longest, controller)
    run = Recording(state, options, watch or Watch(), None, frames, earlier, control)
    here = run.first
    end = start + (begin + duration)
    for seconds, until in frames.moments(start, begin + duration, begin)[1:]:
        while state.core.time < until:
            to_frame = count and count - (before + run.steps) % count
            most = 1 if error is not None else to_frame
            here_at = state.core.time
            outcome = run.advance_adaptive(
                until, end, most, tolerance, tolerance * rate, longest, controller, state.threads,
                state.threads_optional,
            )  # fmt: skip
            state.judge(outcome, controller.h)
            if error is not None and state.core.watched[0]["in_contact"]:
                error = None
            if error is not None and outcome["steps"]:
                passed = state.core.time - here_at
                here = _tell(state, here, here_at - start, passed, 1, error, outcome["error"])
            if count and state.core.time < until and (before + run.steps) % count == 0:
                run.store(state.core.time - start, state.core.time)
        if state.core.time > until:
            run.store_dense(seconds, until)
        else:
            run.store(seconds, until)
    return Solution.of(run)


def run_fixed(
    scene: Scene,
    duration: float,
    dt: float,
    options: Options,
    frames: Schedule | None = None,
    watch: Watch | None = None,
    own_step: bool = False,
    error: Observer | None = None,
    resumed: Resumed | None = None,
) -> Solution:
    """One run at a fixed time step, a shorter one before a frame that it does not divide.

    `own_step`: the step is not the caller's, so nobody is warned of it. `error`: is told of every
    step until a contact. `resumed`: the run to go on from.
    """
    if resumed is None:
        state, earlier = options.state(scene), Continuation(options.start)
    else:
        state, earlier = resumed.state(scene, options), resumed.continuation
    state.warned = state.warned_of_growth = own_step
    state.core.set_watch(sample_every(duration / dt, options.sampling), 0.0)
    frames = (frames or Schedule()).in_seconds(dt)
    moments = frames.moments(earlier.start, earlier.seconds + duration, earlier.seconds)
    run = Recording(state, options, watch or Watch(), dt, frames, earlier)
    if not own_step:
        state.announce(duration / dt, dt)
    state.announced = True
    here = run.first
    for (begin, _), (end, t) in pairwise(moments):
        if error is None:
            advance_to(run, begin, end, dt)
        else:
            here = _advance_told(run, begin, end, dt, error, here)
            error = None if state.core.watched[0]["in_contact"] else error
        run.store(end, t)
    return Solution.of(run)


def advance_to(state: Any, begin: float, end: float, dt: float) -> int:
    """Steps of `dt` from `begin` to `end`, the last one shorter if need be; how many there were."""
    whole = math.floor((end - begin) / dt + NEGLIGIBLE)
    state.advance(whole, dt)
    rest = (end - begin) - whole * dt
    if rest <= NEGLIGIBLE * dt:
        return whole
    state.advance(1, rest)
    return whole + 1


def _advance_told(
    run: Recording, begin: float, end: float, dt: float, error: Observer, here: Frame
) -> Frame:
    """As `advance_to`, from the state `here`, and `error` is told of all; the state it comes to."""
    whole = math.floor((end - begin) / dt + NEGLIGIBLE)
    rest = (end - begin) - whole * dt
    done, t = 0, begin
    while done < whole:
        steps = error.steps_at_once(t, dt, whole - done)
        run.advance(steps, dt)
        here = _tell(run.state, here, t, dt, steps, error)
        done += steps
        t = begin + done * dt
    if rest > NEGLIGIBLE * dt:
        run.advance(1, rest)
        order = integrators()[run.state.integrator].order_of(run.state.scenes[0])
        here = _tell(run.state, here, t, rest, 1, error, (rest / dt) ** (order + 1))
    return here


def _tell(
    state: State,
    before: Frame,
    t: float,
    dt: float,
    steps: int,
    error: Observer,
    estimate: float = 1.0,
) -> Frame:
    """The state after `steps` steps from `before`, of which `error` is told."""
    paused = time.perf_counter()
    after = np.empty(state.shape), np.empty(state.shape)
    state.store(*after)
    error.observe(t, before, after, dt, steps, estimate)
    error.wall_time += time.perf_counter() - paused
    return after
