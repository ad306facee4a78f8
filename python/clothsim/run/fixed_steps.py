"""One run of a scene, at a fixed time step or with error control, with its cost."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..base import Floats, check
from ..engine.options import Options
from ..engine.snapshot import Snapshot
from ..engine.state import State
from ..methods.bound import guaranteed_dt, stable_dt
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .between import Step
from .frames import NEGLIGIBLE, Moment, Schedule
from .recording import Continuation, Recording, Solution, Steps, Watch

# Velocities are weighed against positions by a frequency above all of the cloth: this many times
# the bound on its frequencies. Errors of x then decide, and those of v are held to the same scale.
_VELOCITY_WEIGHT = 3.0

_ROUNDING = 4e-16  # of a time over the step size, as part of it

# A kink this near, over the time, is at the end of a step: above what the clock rounds.
_ROUNDING_OF_KINKS = 1e-12

_ANY_ERROR = 1e12  # Times the tolerance of a step: errors up to here are taken as they are.


def size_of(scene: Scene) -> float:
    """The longer side of the cloth [m], the size to which a relative tolerance refers."""
    return max(scene.cloth.size)


def checked_tolerances(dt: Any, rtol: Any, atol: Any) -> tuple[float | None, float | None]:
    """The tolerances as numbers; they choose the step, so `dt` must be None."""
    if dt is not None:
        given = check.shown(dt)
        raise ValueError(f"dt must be None with rtol or atol, or with integrator 'auto': they choose it; got {given}")
    rtol = None if rtol is None else check.number("rtol", rtol, minimum=0)
    atol = None if atol is None else check.number("atol", atol, minimum=0)
    if not rtol and not atol and (rtol, atol) != (None, None):
        raise ValueError("rtol or atol must be > 0, got 0 for both")
    return rtol, atol


def rms(difference: Floats) -> float:
    """Root of the mean over mass points of the squared distance."""
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


@dataclass(frozen=True)
class RunOptions(Options):
    """The options of the steps of a run, and its start."""

    start: float = 0.0  # time of the initial state [s]

    def state(self, scene: Any, x: Any = None, v: Any = None, inspect: bool = True) -> State:
        return State(scene, x, v, self.start, self, inspect)


# States at which triangles and stretches are sampled, at least, and most steps between two of them. An adaptive method's
# steps are several times as long.
_SAMPLES = 32
_MOST_STEPS_BETWEEN_SAMPLES = 128
_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES = 16


def sample_every(steps: float) -> int:
    """Steps between two sampled states of a run of `steps` steps."""
    return int(max(1, min(_MOST_STEPS_BETWEEN_SAMPLES, steps // _SAMPLES)))


@dataclass(frozen=True)
class Resumed:
    """A run to be continued: its final state and its settings."""

    snapshot: Snapshot
    continuation: Continuation

    def state(self, scene: Scene, options: RunOptions) -> State:
        state = options.state(scene, inspect=False)
        core = self.snapshot.core
        # A report has the impulses of its own run.
        state.core.restore({name: np.zeros_like(value) if name == "impulses" else value for name, value in core.items()})
        return state


def _begun(scene: Any, options: RunOptions, resumed: Resumed | None) -> tuple[State, Continuation]:
    """The state at the start of a run, and the settings of the run before."""
    if resumed is None:
        return options.state(scene), Continuation(options.start)
    return resumed.state(scene, options), resumed.continuation


def beginning(
    scene: Scene | Sequence[Scene], options: RunOptions, dt: float | None, frames: Schedule, resumed: Resumed | None = None
) -> Recording:
    """A run with its first frame alone."""
    state, earlier = _begun(scene, options, resumed)
    return Recording(state, options, Watch(), dt, frames if dt is None else frames.in_seconds(dt), earlier)


def integrate(
    scene: Scene,
    duration: float,
    tolerance: float,
    options: RunOptions,
    frames: Schedule | None = None,
    watch: Watch | None = None,
    resumed: Resumed | None = None,
    given: list[float] | None = None,
) -> Solution:
    """One run with error control, at a tolerance per step [m].

    Steps end where a piece of a motion ends. In reach of a sphere they are at most half as long as is guaranteed to be
    stable for this method and for rk4.
    `frames`: frames that are counted in steps are ends of accepted steps. Dense output gives other frames until a sphere
    responds, and from then on the polynomial of `interpolated`. `resumed`:
    the run to continue, which sets the tolerance. `given`: prescribed ends of the steps.
    """
    controller = _core.StepController()
    state, earlier = _begun(scene, options, resumed)
    stable = guaranteed_dt(core_cloth(scene.cloth), options.integrator)
    # The law of contact is of order 1 in the step, so a method that takes long steps is no better there.
    near = min(stable, stable_dt(scene)) / 2
    if earlier.control is None:
        stiffness, _ = core_cloth(scene.cloth).mode_bounds
        rate = _VELOCITY_WEIGHT * max(math.sqrt(stiffness), 1.0 / duration)
        controller.h = min(duration, 0.9 * stable)
    else:
        tolerance, rate, controller.state = earlier.control
    state.judge.warned_of_growth = True  # the steps are the method's own
    state.core.set_watch(_MOST_ACCEPTED_STEPS_BETWEEN_SAMPLES, duration / _SAMPLES)
    frames = frames or Schedule()
    start, count, begin, before = earlier.start, frames.steps, earlier.seconds, earlier.steps
    control = lambda: (tolerance, rate, controller.state)  # noqa: E731
    run = Recording(state, options, watch or Watch(), None, frames, earlier, control)
    end = start + (begin + duration)
    grid, steps = deque(given or ()), Steps(tolerance)
    stops = deque([*scene.stops(start + begin, end), end])
    rounding = _ROUNDING_OF_KINKS * max(abs(start), abs(end))
    # Steps that are given are accepted at any finite error.
    unit = tolerance if given is None else _ANY_ERROR * tolerance
    for seconds, until in frames.moments(start, begin + duration, begin)[1:]:
        while (now := state.core.time) < until:
            while grid and grid[0] <= now:
                grid.popleft()
            while len(stops) > 1 and stops[0] <= now + rounding:
                stops.popleft()
                steps.kinks.append(len(steps.ends))
            target = min(grid[0] if len(grid) > 1 else end, stops[0])
            controller.h = target - now if given else controller.h
            last, stop = now, min(until, stops[0])
            outcome = run.advance_adaptive(stop, target, unit, unit * rate, near, controller, state.threads)
            state.judge.outcome(outcome, controller.h)
            if not outcome["steps"]:
                break  # what is left is rounding of the clock
            steps.ends.append(state.core.time)
            steps.local_error += unit * outcome["error"]
            if count and state.core.time < until and (before + run.steps) % count == 0:
                run.store(state.core.time - start, state.core.time)
        if state.core.time <= until:
            run.store(seconds, until)
        elif not state.core.watched[0]["in_contact"]:
            run.store_dense(seconds, until)
        else:
            step = last, state.core.time - last, run.dense(last), run.arrays_now()
            run.store_between(seconds, until, step)
    return run.solution(steps)


def run_fixed(
    scene: Scene | Sequence[Scene],
    duration: float,
    dt: float,
    options: RunOptions,
    frames: Schedule | None = None,
    watch: Watch | None = None,
    own_step: bool = False,
    resumed: Resumed | None = None,
) -> Recording:
    """One run, or a batch with one for each scene, at a fixed time step. The last step is shorter where the step size does
    not divide the duration.

    Frames between two steps are interpolated, so that they never change the run.

    `own_step`: the step is not the caller's, so no warning names it, and no snapshot of a batch is kept. `resumed`: the run
    to go on from.
    """
    state, earlier = _begun(scene, options, resumed)
    state.judge.warned_of_dt = state.judge.warned_of_growth = own_step
    state.core.set_watch(sample_every(duration / dt), 0.0)
    frames = (frames or Schedule()).in_seconds(dt)
    moments = frames.moments(earlier.start, earlier.seconds + duration, earlier.seconds)
    run = Recording(state, options, watch or Watch(), dt, frames, earlier)
    run.saves = not own_step
    _pass_frames(run, moments, dt)
    return run


def _pass_frames(run: Recording, moments: list[Moment], dt: float) -> None:
    """Take steps of `dt` from the first moment to the last, and store a frame at each of the others."""
    begin, origin = moments[0]
    length = moments[-1][0] - begin
    whole = math.floor(length / dt + NEGLIGIBLE)
    rest = length - whole * dt
    last = rest > NEGLIGIBLE * dt  # there is a shorter last step
    done = 0

    def advance(steps: int) -> None:
        """To the end of so many steps."""
        nonlocal done
        if min(steps, whole) > done:
            run.advance(min(steps, whole) - done, dt)
        if steps > whole >= done:
            run.advance(1, rest)
        done = max(done, steps)

    between: Step | None = None
    for seconds, t in moments[1:-1]:
        passed = (seconds - begin) / dt
        steps = math.floor(passed + NEGLIGIBLE + passed * _ROUNDING)
        if passed - steps <= NEGLIGIBLE + passed * _ROUNDING:
            advance(steps)
            run.store(seconds, t)
            continue
        if between is None or done <= steps:
            advance(steps)
            before = run.arrays_now()
            advance(steps + 1)
            between = origin + steps * dt, dt if steps < whole else rest, before, run.arrays_now()
        run.store_between(seconds, t, between)
    advance(whole + last)
    run.store(*moments[-1])
