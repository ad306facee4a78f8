"""One run of a scene, at a fixed time step or with error control, and what it cost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from . import _core
from ._state import State
from .integration import integrators
from .plan import core_cloth
from .scene import Scene
from .stability.bound import guaranteed_dt

Floats = npt.NDArray[np.float64]
Frame = tuple[Floats, Floats]  # positions and velocities
Progress = Callable[[list[Any]], Iterable[Any]]


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

    def state(self, scene: Any, x: Any = None, v: Any = None) -> State:
        return State(
            scene, x, v, t=0.0, integrator=self.integrator, precision=self.precision,
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
    watched: Mapping[str, Any]  # extremes over the states at the ends of steps, as the core tells them
    step: float  # fixed: the time step, adaptive: the mean one [s]
    state: State

    @property
    def contacts(self) -> bool:
        """Whether a sphere has responded."""
        return bool(self.watched["in_contact"])


def integrate(
    scene: Scene,
    duration: float,
    tolerance: float,
    options: Options,
    every: int | float | None,
    progress: Progress = iter,
    error: Observer | None = None,
    longest: float | None = None,
) -> Solution:
    """One run with error control, at a tolerance per step [m].

    `every`: an int stores each so many accepted steps, a float so many seconds by dense output.
    `error`: is told of every step until a contact. `longest`: the first step, and none is longer
    [s]; at a tolerance that all steps meet they are equal.
    """
    state = options.state(scene)
    stiffness, _ = core_cloth(scene).mode_bounds
    rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / duration)
    controller = _core.StepController()
    if longest is None:
        longest = duration
        controller.h = min(duration, 0.9 * guaranteed_dt(core_cloth(scene), options.integrator))
    else:
        # A hair more, so that what rounding leaves of the duration is not a step of its own.
        controller.h = longest = (1 + 1e-9) * longest
    state.core.set_watch(_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES, duration / options.sampling)
    frames = _Frames(state)
    steps = rejected = 0
    at_steps = isinstance(every, int)
    times = [duration] if every is None or at_steps else frame_times(duration, every)[1:]
    count = every if at_steps else 2**62
    told, begun = error, error.wall_time if error else 0.0
    here = frames.first

    start = time.perf_counter()
    for until in progress(times):
        while state.core.time < until:
            begin = state.core.time
            outcome = state.core.advance_adaptive(
                until, duration, 1 if error is not None else count, tolerance, tolerance * rate, longest,
                controller, state.threads, state.threads_optional,
            )  # fmt: skip
            if "point" in outcome:
                outcome["step"] += steps
            state.judge(outcome, controller.h)
            steps += outcome["steps"]
            rejected += outcome["rejected"]
            if error is not None and state.core.watched[0]["in_contact"]:
                error = None
            if error is not None and outcome["steps"]:
                here = _tell(
                    state, here, begin, state.core.time - begin, 1, error, outcome["error"]
                )
            if at_steps and state.core.time < until and steps % count == 0:
                frames.store(state.core.time)
        if state.core.time > until:
            frames.store_dense(until)
        else:
            frames.store(until)
    wall_time = time.perf_counter() - start
    wall_time -= told.wall_time - begun if told else 0.0
    return Solution(
        options, frames.t, *frames.arrays(), steps, rejected, state.core.evaluations[0], wall_time,
        state.core.watched[0], duration / steps, state,
    )  # fmt: skip


def run_fixed(
    scene: Scene,
    duration: float,
    dt: float,
    options: Options,
    times: list[float],
    progress: Progress = iter,
    own_step: bool = False,
    error: Observer | None = None,
) -> Solution:
    """One run at a fixed time step, a shorter one before a frame that it does not divide.

    `own_step`: the step is not the caller's, so nobody is warned of it. `error`: is told of every
    step until a contact.
    """
    state = options.state(scene)
    state.warned = state.warned_of_growth = own_step
    state.core.set_watch(sample_every(duration / dt, options.sampling), 0.0)
    if not own_step:
        state.announce(duration / dt, dt)
    state.announced = True
    frames = _Frames(state)
    steps, wall_time = 0, 0.0
    here = frames.first
    for begin, end in progress(list(zip(times[:-1], times[1:]))):
        start = time.perf_counter()
        if error is None:
            steps += advance_to(state, begin, end, dt)
        else:
            begun = error.wall_time
            more, here = _advance_told(state, begin, end, dt, error, here)
            steps += more
            wall_time -= error.wall_time - begun
            error = None if state.core.watched[0]["in_contact"] else error
        wall_time += time.perf_counter() - start
        frames.store(end)
    evaluations = 4 * steps if options.integrator == "rk4" else state.core.evaluations[0]
    return Solution(
        options, frames.t, *frames.arrays(), steps, 0, evaluations, wall_time,
        state.core.watched[0], dt, state,
    )  # fmt: skip


class _Frames:
    """States stored along a run; the first is that of the start."""

    def __init__(self, state: State) -> None:
        self._state = state
        self.t: list[float] = []
        self._x: list[Floats] = []
        self._v: list[Floats] = []
        self.store(0.0)

    def _new(self, t: float) -> tuple[Floats, Floats]:
        x, v = np.empty(self._state.shape), np.empty(self._state.shape)
        self.t.append(t)
        self._x.append(x)
        self._v.append(v)
        return x, v

    def store(self, t: float) -> None:
        self._state.store(*self._new(t))
        self._state.core.sample()

    def store_dense(self, t: float) -> None:
        self._state.core.dense(t, *self._new(t), self._state.threads)

    @property
    def first(self) -> Frame:
        return self._x[0], self._v[0]

    def arrays(self) -> tuple[Floats, Floats]:
        return np.array(self._x), np.array(self._v)


# A remainder below this part of a step is rounding of the caller's numbers, not a step.
NEGLIGIBLE = 1e-9


def frame_times(duration: float, between: float) -> list[float]:
    """0, each multiple of `between` before the end, and the end [s]."""
    count = math.ceil(duration / between - NEGLIGIBLE)
    return [k * between for k in range(count)] + [duration]


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
    state: State, begin: float, end: float, dt: float, error: Observer, here: Frame
) -> tuple[int, Frame]:
    """As `advance_to`, from the state `here`, and `error` is told of all; steps, and the state."""
    whole = math.floor((end - begin) / dt + NEGLIGIBLE)
    rest = (end - begin) - whole * dt
    done, t = 0, begin
    while done < whole:
        steps = error.steps_at_once(t, dt, whole - done)
        state.advance(steps, dt)
        here = _tell(state, here, t, dt, steps, error)
        done += steps
        t = begin + done * dt
    if rest > NEGLIGIBLE * dt:
        state.advance(1, rest)
        order = integrators()[state.integrator].order_of(state.scenes[0])
        here = _tell(state, here, t, rest, 1, error, (rest / dt) ** (order + 1))
        done += 1
    return done, here


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
