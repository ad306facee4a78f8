"""Error control: from an error that is asked for to a run that has it, and the estimate of it.

What is asked is the error of the positions at the end of the run, as the root of the mean square
over the mass points: ``atol + rtol * size`` with the longer side of the cloth as its size.

1. **Growth.** Where the tolerance is so small that it matters, a twin of the run whose positions
   are perturbed by 1e-8 of the size is computed (`growth_of_perturbations`, by the cheapest
   method). The growth times the rounding of the precision is the floor below which no method comes.
2. **Solution.** An adaptive method (or a fixed-step one at some time step) runs at a tolerance per
   step that is proportional to what is asked.
3. **Estimate.** A companion runs at a tenth of that tolerance (or half the time step). The
   difference is the error. Where it is above what is asked, the companion becomes the solution and
   gets a companion of its own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core
from ._state import State
from .errors import UnstableError
from .integration import integrators
from .plan import core_cloth
from .scene import Scene
from .stability.bound import guaranteed_dt

Floats = npt.NDArray[np.float64]
Progress = Callable[[list[Any]], Iterable[Any]]

# Tolerance per step over the error asked for, where perturbations do not grow. The estimate of a
# step's error is larger than the error, most of all in dop853; measured on the scenes of
# `clothsim.scenes` (docs/integrators.md).
_STEP_TOLERANCE = {"dop853": 15.0, "dopri5": 0.3}
# ... divided by sqrt(1 + growth / this).
_HARMLESS_GROWTH = 3e4

# Velocities are weighed against positions by a frequency above all of the cloth: this many times
# the bound on its frequencies. Errors of x then decide, and those of v are held to the same scale.
_VELOCITY_WEIGHT = 3.0

# The companion's tolerance over that of the solution.
_COMPANION = 0.1

# Below this part of the size the floor of rounding may matter, and the growth is computed.
_MAY_BE_FLOOR = 1e-7

_PERTURBATION = 1e-8  # of the size
_CHECKS = 16  # times at which the perturbed twin is compared

_ATTEMPTS = 8


def size_of(scene: Scene) -> float:
    """The longer side of the cloth [m]: what a relative tolerance is relative to."""
    return max(scene.cloth.size)


def rms(difference: Floats) -> float:
    """Root of the mean over mass points of the squared distance."""
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


@dataclass(frozen=True)
class Options:
    """How the steps are computed, as `step` takes it."""

    integrator: str
    precision: str
    threads: int | None
    kernel: str
    strict: bool
    backend: str = "cpu"

    def state(self, scene: Any, x: Any = None, v: Any = None) -> State:
        return State(
            scene, x, v, t=0.0, integrator=self.integrator, precision=self.precision,
            threads=self.threads, kernel=self.kernel, strict=self.strict, backend=self.backend,
        )  # fmt: skip

    def replace(self, **changes: Any) -> Options:
        return Options(**{**self.__dict__, **changes})


def _contacts(state: State, scene: Scene) -> int:
    """Answers of the spheres so far; those of "continuous" are not counted: taken to be there."""
    continuous = any(sphere.response == "continuous" for sphere in scene.spheres)
    return int(state.core.contacts[0]) + continuous


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
    wall_time: float
    contacts: int  # answers of the spheres to mass points
    first_contact: float | None  # end of the first step with one [s]; fixed steps: not known
    step: float  # fixed: the time step, adaptive: the mean one [s]
    state: State


def integrate(
    scene: Scene,
    duration: float,
    tolerance: float,
    options: Options,
    every: int | float | None,
    progress: Progress = iter,
) -> Solution:
    """One run with error control, at a tolerance per step [m].

    `every`: an int stores each so many accepted steps, a float so many seconds by dense output.
    """
    state = options.state(scene)
    stiffness, _ = core_cloth(scene).mode_bounds
    rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / duration)
    controller = _core.StepController()
    controller.h = min(duration, 0.9 * guaranteed_dt(core_cloth(scene), options.integrator))
    frames = _Frames(state)
    steps = rejected = 0
    first_contact = None
    at_steps = isinstance(every, int)
    times = [duration] if every is None or at_steps else frame_times(duration, every)[1:]
    count = every if at_steps else 2**62

    start = time.perf_counter()
    for until in progress(times):
        while state.core.time < until:
            # One contact at a time until the first is found: its moment goes into the report.
            watching = bool(scene.spheres) and first_contact is None
            outcome = state.core.advance_adaptive(
                until, duration, 1 if watching else count, tolerance, tolerance * rate, duration,
                controller, state.threads, state.threads_optional,
            )  # fmt: skip
            if "point" in outcome:
                outcome["step"] += steps
                state._raise_error(outcome, controller.h)
            steps += outcome["steps"]
            rejected += outcome["rejected"]
            if watching and outcome["contacts"]:
                first_contact = state.core.time
            if at_steps and state.core.time < until and steps % count == 0:
                frames.store(state.core.time)
        if state.core.time > until:
            frames.store_dense(until)
        else:
            frames.store(until)
    wall_time = time.perf_counter() - start
    return Solution(
        options, frames.t, *frames.arrays(), steps, rejected, state.core.evaluations[0], wall_time,
        state.core.contacts[0], first_contact, duration / steps, state,
    )  # fmt: skip


def run_fixed(
    scene: Scene,
    duration: float,
    dt: float,
    options: Options,
    times: list[float],
    progress: Progress = iter,
    own_step: bool = False,
) -> Solution:
    """One run at a fixed time step, a shorter one before a frame that it does not divide.

    `own_step`: the step is not the caller's, so nobody is warned of it.
    """
    state = options.state(scene)
    state.warned = own_step
    frames = _Frames(state)
    steps, wall_time = 0, 0.0
    for begin, end in progress(list(zip(times[:-1], times[1:]))):
        start = time.perf_counter()
        steps += advance_to(state, begin, end, dt)
        wall_time += time.perf_counter() - start
        frames.store(end)
    evaluations = 4 * steps if options.integrator == "rk4" else state.core.evaluations[0]
    return Solution(
        options, frames.t, *frames.arrays(), steps, 0, evaluations, wall_time,
        _contacts(state, scene), None, dt, state,
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

    def store_dense(self, t: float) -> None:
        self._state.core.dense(t, *self._new(t), self._state.threads)

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


@dataclass(frozen=True)
class Growth:
    """By how much a small perturbation grew at most, between any two times of the run."""

    factor: float
    evaluations: int


def growth_of_perturbations(scene: Scene, duration: float, options: Options) -> Growth:
    """The growth of a random perturbation of the positions, by a perturbed twin run.

    Both run by the semi-implicit Euler method near its stability limit, the cheapest there is: a
    factor is wanted, not a solution.
    """
    options = options.replace(integrator="semi_implicit_euler", precision="double")
    dt = min(0.9 * guaranteed_dt(core_cloth(scene), options.integrator), duration / 4)
    x, v = scene.initial_position, scene.initial_velocity
    free = ~scene.cloth.pinned[..., None]
    noise = np.random.default_rng(1).standard_normal(x.shape) * free
    size = _PERTURBATION * size_of(scene)
    noise *= size / rms(noise) if noise.any() else 0.0
    twins = options.state(scene, np.stack([x, x + noise]), np.stack([v, v]))
    now, least, most = np.empty(twins.shape), 1.0, 1.0
    rate = np.empty(twins.shape)
    times = np.linspace(0.0, duration, _CHECKS + 1)
    steps = 0
    for begin, end in zip(times[:-1], times[1:]):
        try:
            steps += advance_to(twins, begin, end, dt)
        except UnstableError:
            break
        twins.store(now, rate)
        ratio = rms(now[1] - now[0]) / size
        least = min(least, max(ratio, 1e-300))
        most = max(most, ratio / least)
    return Growth(most, 2 * steps)


@dataclass
class Controlled:
    """A solution to a tolerance, with the account of how it was found."""

    solution: Solution
    companion: Solution
    asked: float
    floor: float
    growth: float | None  # None: so far above the floor that it was not computed
    difference: Floats | None  # error of the last positions by that of the two; None: chaotic
    evaluations: int  # spent on anything but the solution


def solve(
    scene: Scene,
    duration: float,
    asked: float,
    options: Options,
    every: int | float | None,
    progress: Progress = iter,
) -> Controlled:
    """The run whose error is at most `asked` [m], rms, or at the floor of rounding."""
    size = size_of(scene)
    growth, spent = None, 0
    if asked < _MAY_BE_FLOOR * size:
        found = growth_of_perturbations(scene, duration, options)
        growth, spent = found.factor, found.evaluations
    rounding = np.finfo(np.float32 if options.precision == "single" else np.float64).eps
    floor = float(rounding) * size * (growth or 1.0)
    goal = max(asked, floor)

    if integrators()[options.integrator].adaptive:
        method: _Adaptive | _Fixed = _Adaptive(scene, duration, every, goal, growth or 1.0, options)
    else:
        method = _Fixed(scene, duration, every, options)
    # The companion computes in double: what single loses is part of the error.
    exact = options.replace(precision="double")
    parameter = method.first
    solution = method.run(parameter, options, progress)
    for attempt in range(_ATTEMPTS):
        finer = parameter * method.companion
        companion = method.run(finer, exact, iter)
        spent += companion.evaluations
        if companion.contacts or solution.contacts:
            difference = None
            break
        # The companion has a part of the error itself.
        difference = (companion.x[-1] - solution.x[-1]) / (1 - method.companion**method.order)
        error = rms(difference)
        # Two runs at the floor differ by rounding, whatever their tolerance.
        at_floor = asked <= floor and error <= 10 * floor
        if error <= goal or at_floor or attempt == _ATTEMPTS - 1:
            break
        spent += solution.evaluations
        parameter = method.better(parameter, goal / error)
        options = exact
        if parameter < finer:
            solution = method.run(parameter, options, iter)
        else:
            parameter, solution = finer, companion
            spent -= companion.evaluations
    return Controlled(solution, companion, asked, floor, growth, difference, spent)


class _Adaptive:
    """Runs of an adaptive method; the parameter is the tolerance of a step [m]."""

    companion = 0.1
    order = 1  # of the error in the tolerance: about proportional

    def __init__(
        self,
        scene: Scene,
        duration: float,
        every: int | float | None,
        goal: float,
        growth: float,
        options: Options,
    ) -> None:
        self._scene, self._duration, self._every = scene, duration, every
        factor = _STEP_TOLERANCE[options.integrator] / math.sqrt(1.0 + growth / _HARMLESS_GROWTH)
        self.first = goal * factor

    def run(self, tolerance: float, options: Options, progress: Progress) -> Solution:
        return integrate(
            self._scene, self._duration, tolerance, options, self._every, progress
        )

    def better(self, tolerance: float, ratio: float) -> float:
        return tolerance * min(self.companion, ratio / 2)


class _Fixed:
    """Runs of a fixed-step method; the parameter is the time step [s]."""

    companion = 0.5

    def __init__(
        self, scene: Scene, duration: float, every: int | float | None, options: Options
    ) -> None:
        self.order = integrators()[options.integrator].order
        # The error of a method of order 1 is too large at its limit to try it.
        longest = (0.75 if self.order == 1 else 0.95) * guaranteed_dt(
            core_cloth(scene), options.integrator
        )
        self.first = duration / max(4, math.ceil(duration / longest))
        self._scene, self._duration = scene, duration
        # An int counts the steps of the first run, so that all runs have the same frames.
        between = duration if every is None else every * self.first if isinstance(every, int) else every
        self._times = frame_times(duration, between)

    def run(self, dt: float, options: Options, progress: Progress) -> Solution:
        return run_fixed(self._scene, self._duration, dt, options, self._times, progress)

    def better(self, dt: float, ratio: float) -> float:
        return dt * min(self.companion, (ratio / 2) ** (1 / self.order))


# Above this part of the size an undamped scene is cheapest with PEFRL, and a cloth of many modes,
# whose step stability limits, with the semi-implicit Euler method.
_PEFRL_ABOVE = 1e-5
_EULER_ABOVE = 3e-4
_MANY_OSCILLATIONS = 100.0  # of the fastest mode, in radians

# Above this part of the size the rounding of single, even grown a hundredfold, is no matter. The
# companion, in double, finds out where it grows more.
_SINGLE_ABOVE = 1e-4


def automatic(scene: Scene, duration: float, asked: float, options: Options) -> Options:
    """Method and precision for an error [m].

    dop853 has the least cost at small errors, and at most 1.5 times the least where stability
    limits the step, with the exceptions above (docs/integrators.md has the table).
    """
    part = asked / size_of(scene)
    stiffness, damping = core_cloth(scene).mode_bounds
    method = "dop853"
    if damping == 0 and part >= _PEFRL_ABOVE:
        method = "pefrl"
    elif part >= _EULER_ABOVE and math.sqrt(stiffness) * duration >= _MANY_OSCILLATIONS:
        method = "semi_implicit_euler"
    single = part >= _SINGLE_ABOVE and not options.strict
    return options.replace(integrator=method, precision="single" if single else "double")
