"""Error control: from an error that is asked for to a run that has it, and the estimate of it.

What is asked is the error of the positions at the end of the run, as the root of the mean square
over the mass points: ``atol + rtol * size`` with the longer side of the cloth as its size.

1. **Solution.** An adaptive method (or a fixed-step one at some time step) runs at a tolerance per
   step that is proportional to what is asked.
2. **Estimate.** The error of a cloth is carried along with the run (`carried`); if that comes out
   too large, a companion at a tenth of the tolerance decides, as it does for scenes of few modes,
   whose runs have few steps. If the error is above what is asked, the run is done again at a
   smaller tolerance.
3. **Few oscillations.** Where the method is not named, their runs go in equal steps (`refined`).
4. **Floor.** Where the tolerance is so small that rounding may matter, a perturbed twin tells by
   how much it is magnified (`growth`): the floor below which no method comes in that precision.

After a contact no error can be told. Then a companion at a tenth of the tolerance shows how far
outcomes agree.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .carried import DAMPING, CarriedError
from .errors import UnstableError
from .frames import Floats, Schedule
from .growth import growth_of_perturbations
from .integration import integrators
from .plan import core_cloth
from .recording import Watch
from .refined import is_few, refine
from .runs import Options, Solution, integrate, rms, run_fixed, size_of
from .scene import Scene
from .stability.bound import guaranteed_dt
from .stiffest import Stiffest

# Tolerance per step over the error asked for. The estimate of a step's error is larger than the
# error, most of all in dop853; measured on the scenes of `clothsim.scenes` (docs/integrators.md).
_STEP_TOLERANCE = {"dop853": 15.0, "dopri5": 0.3}
# ... divided by sqrt(1 + growth / this), or by that where the growth is not known.
_HARMLESS_GROWTH = 3e4
_UNKNOWN_GROWTH = 3.6

# The largest tolerance per step, over the size, for a cloth of many modes. At larger ones stability
# alone limits the steps: they become hardly longer, and errors of stiff motion come and go, which
# makes the estimate several times too large.
_LARGEST_TOLERANCE = {"dop853": 2e-7, "dopri5": math.inf}

_MANY_OSCILLATIONS = 100.0  # of the fastest mode, in radians: the error is carried

_FEW_STEPS = 80  # of a run: its carried error does not count

# Of what a finer companion's error should be over the solution's, no less than this is believed.
_CAUTIOUS = 0.25

# Below this part of the size the floor of rounding may matter, and the growth is computed.
_MAY_BE_FLOOR = 1e-9

# Estimates are taken times this, for they may be too small: carried ones, and those of a finer
# companion.
_DOUBT, _DOUBT_OF_FINER = 1.4, 1.1

# The step of a fixed-step method over that which is stable about the start: frequencies and damping
# grow as a cloth is pulled. That of order 1 is too wrong at its limit, unless errors are forgotten.
_NEAR, _NEAR_OF_VERLET, _NEAR_OF_ORDER_1 = 0.95, 0.78, 0.75

# Damping that the carrying of a small error follows, over the highest frequency: with less of it
# the estimate comes out up to five times too large.
_DAMPING_OF_SMALL = 1.5

_ATTEMPTS = 8


@dataclass
class Controlled:
    """A solution to a tolerance, with the account of how it was found."""

    solution: Solution
    companion: Solution | None  # after a contact
    asked: float
    floor: float
    growth: float | None  # None: the error is not rounding, so it was not computed
    error: Floats | None  # of the last positions; None: chaotic
    evaluations: int  # spent on anything but the solution
    wall_time: float  # of that [s]


def solve(
    scene: Scene,
    duration: float,
    asked: float,
    choices: Sequence[Options],
    frames: Schedule,
    watch: Watch | None = None,
    named: bool = True,
) -> Controlled:
    """The run whose error is at most `asked` [m], rms, or at the floor of rounding.

    Each of `choices` is tried once, and the last one at smaller tolerances until it does. `named`:
    the caller named the method, so that its steps are its own.
    """
    size, rest = size_of(scene), list(choices)
    growth, floor, spent, wall_time = None, 0.0, 0, 0.0
    if asked < _MAY_BE_FLOOR * size * (1 - 1e-9):
        growth = 1.0
        if not _forgets(scene, duration, asked):
            found = growth_of_perturbations(scene, duration, rest[-1])
            growth, spent, wall_time = found.factor, found.evaluations, found.wall_time
        rounding = np.finfo(np.float32 if rest[-1].precision == "single" else np.float64).eps
        floor = float(rounding) * size * growth
    goal = max(asked, floor)
    # At the floor runs differ by rounding, whatever their tolerance.
    enough = 10 * floor if asked <= floor else goal
    equal_steps = not named and rest[0].integrator == "dop853" and not scene.spheres
    if equal_steps and is_few(scene, duration):
        refined = refine(scene, duration, enough, rest[0], frames, watch)
        spent += refined.evaluations
        wall_time += refined.wall_time
        if refined.solution:
            return Controlled(
                refined.solution, None, asked, floor, growth, refined.error, spent, wall_time
            )
    damping = DAMPING if growth is None else _DAMPING_OF_SMALL
    options = rest.pop(0)
    stiffest = None
    if _many_modes(scene, duration):
        begin = time.perf_counter()
        stiffest = Stiffest(scene, options)
        spent += stiffest.evaluations
        wall_time += time.perf_counter() - begin
    method = _method(scene, duration, frames, goal, growth, options, stiffest)
    parameter = method.first
    for attempt in range(_ATTEMPTS):
        carried = CarriedError(scene, duration, options, stiffest, damping) if stiffest else None
        exact = options.replace(precision="double")
        companion, error = None, math.inf
        try:
            solution = method.run(parameter, options, watch, carried)
        except UnstableError as unstable:
            # A step that is stable about the start need not be so later.
            if parameter <= method.safe:
                raise
            spent += unstable.step * method.per_step + (carried.evaluations if carried else 0)
            parameter = method.safe
            continue
        if carried:
            spent += carried.evaluations
            wall_time += carried.wall_time
            difference = _DOUBT * carried.x
            error = rms(difference)
        # A carried error may be too large where stability limits the steps, and is too small where
        # there are few, each with an error of its own: a companion decides.
        few = solution.steps < _FEW_STEPS
        if solution.contacts or not carried or few or (error > enough and not rest):
            companion = method.run(parameter * method.finer, exact, None, None)
            spent += companion.evaluations
            wall_time += companion.wall_time
            if solution.contacts or companion.contacts:
                return Controlled(
                    solution, companion, asked, floor, growth, None, spent, wall_time
                )
            difference = _DOUBT_OF_FINER * method.extrapolated(solution, companion)
            error = rms(difference)
        gain = max(method.gain, _CAUTIOUS)
        if companion and error > goal >= 2 * gain * error:
            # The finer companion is the solution.
            spent += solution.evaluations - companion.evaluations
            wall_time += solution.wall_time - companion.wall_time
            solution, difference = companion, difference * gain
            break
        if error <= enough or attempt == _ATTEMPTS - 1:
            break
        spent += solution.evaluations
        wall_time += solution.wall_time
        if rest:
            options = rest.pop(0)
            method = _method(scene, duration, frames, goal, growth, options, stiffest)
            parameter = method.first
        else:
            parameter = method.better(parameter, goal / error)
            options = exact
    return Controlled(solution, None, asked, floor, growth, difference, spent, wall_time)


def _method(
    scene: Scene,
    duration: float,
    frames: Schedule,
    goal: float,
    growth: float | None,
    options: Options,
    stiffest: Stiffest | None,
) -> _Adaptive | _Fixed:
    if integrators()[options.integrator].adaptive:
        many = stiffest is not None
        return _Adaptive(scene, duration, frames, goal, growth, options.integrator, many)
    return _Fixed(scene, duration, frames, goal, options.integrator, stiffest)


def _many_modes(scene: Scene, duration: float) -> bool:
    stiffness, _ = core_cloth(scene).mode_bounds
    return math.sqrt(stiffness) * duration >= _MANY_OSCILLATIONS


class _Adaptive:
    """Runs of an adaptive method; the parameter is the tolerance of a step [m]."""

    finer = gain = 0.1  # the parameter of a better run over that of another, and its error
    safe, per_step = math.inf, 0

    def __init__(
        self,
        scene: Scene,
        duration: float,
        frames: Schedule,
        goal: float,
        growth: float | None,
        integrator: str,
        many_modes: bool,
    ) -> None:
        self._scene, self._duration, self._frames = scene, duration, frames
        factor = _STEP_TOLERANCE[integrator]
        if growth is not None:
            factor /= math.sqrt(1.0 + growth / _HARMLESS_GROWTH)
        elif many_modes:
            factor /= _UNKNOWN_GROWTH
        largest = _LARGEST_TOLERANCE[integrator] * size_of(scene) if many_modes else math.inf
        self.first = min(goal * factor, largest)

    def run(
        self, tolerance: float, options: Options, watch: Watch | None, error: CarriedError | None
    ) -> Solution:
        return integrate(
            self._scene, self._duration, tolerance, options, self._frames, watch, error
        )

    def extrapolated(self, solution: Solution, companion: Solution) -> Floats:
        """The error of the last positions, by a run at `finer` times the tolerance."""
        return (solution.x[-1] - companion.x[-1]) / (1 - self.gain)

    def better(self, tolerance: float, ratio: float) -> float:
        return tolerance * min(0.5, ratio / 2)


class _Fixed:
    """Runs of a fixed-step method; the parameter is the time step [s]."""

    finer = 0.5

    def __init__(
        self,
        scene: Scene,
        duration: float,
        frames: Schedule,
        goal: float,
        integrator: str,
        stiffest: Stiffest | None,
    ) -> None:
        method = integrators()[integrator]
        self._order = method.order
        self.gain = self.finer**self._order  # the error at that part of a step
        self.per_step = method.evaluations_per_step(core_cloth(scene).mode_bounds[1] > 0)
        near = _NEAR_OF_VERLET if integrator == "velocity_verlet" else _NEAR
        guaranteed = guaranteed_dt(core_cloth(scene), integrator)
        limit = stiffest.limit(integrator) if stiffest else guaranteed
        if self._order == 1 and not _forgets(scene, duration, goal):
            near, limit = _NEAR_OF_ORDER_1, guaranteed
        self.first, self.safe = (self._divided(duration, near * dt) for dt in (limit, guaranteed))
        self._scene, self._duration = scene, duration
        # Frames counted in steps are those of the first run, so that all runs have the same frames.
        self._frames = frames.in_seconds(self.first)

    @staticmethod
    def _divided(duration: float, longest: float) -> float:
        return duration / max(4, math.ceil(duration / longest))

    def run(
        self, dt: float, options: Options, watch: Watch | None, error: CarriedError | None
    ) -> Solution:
        return run_fixed(
            self._scene, self._duration, dt, options, self._frames, watch, own_step=True, error=error
        )

    def extrapolated(self, solution: Solution, companion: Solution) -> Floats:
        """The error of the last positions, by a run at half the step."""
        return (solution.x[-1] - companion.x[-1]) / (1 - self.gain)

    def better(self, dt: float, ratio: float) -> float:
        return dt * min(self.finer, (ratio / 2) ** (1 / self._order))


# Above this part of the size an undamped scene is cheapest with PEFRL, and a damped cloth of many
# modes, whose step stability limits, with the Verlet method in single or that of Runge and Kutta.
_PEFRL_ABOVE = 3e-5
_VERLET_ABOVE, _RK4_ABOVE = 3e-4, 8e-6

# Point damping of rate g (1/s) takes errors down with exp(-g t / 2), unless a mode is slower yet.
# Where it takes the whole size down to this part of what is asked, all that was wrong on the way
# is forgotten at the end, and the cheapest method that is stable may do.
_FORGOTTEN = 1e-2


def _forgets(scene: Scene, duration: float, asked: float) -> bool:
    rate = scene.cloth.point_damping / scene.cloth.mass_per_point.max()
    return math.exp(-rate * duration / 2) <= _FORGOTTEN * asked / size_of(scene)


def automatic(scene: Scene, duration: float, asked: float, options: Options) -> list[Options]:
    """Methods and precisions to try for an error [m], the most promising first.

    dop853 has the least cost at small errors, and at most twice the least where stability limits
    the step, with the exceptions above (docs/integrators.md has the table).
    """
    part = asked / size_of(scene)
    _, damping = core_cloth(scene).mode_bounds
    order8 = options.replace(integrator="dop853", precision="double")
    if damping == 0 and part >= _PEFRL_ABOVE:
        return [order8.replace(integrator="pefrl"), order8]
    if not _many_modes(scene, duration):
        return [order8]
    if _forgets(scene, duration, asked):
        return [order8.replace(integrator="semi_implicit_euler"), order8]
    if part >= _VERLET_ABOVE:
        precision = "double" if options.strict else "single"
        return [order8.replace(integrator="velocity_verlet", precision=precision), order8]
    # With fixed steps the moment of a contact is not known.
    if part >= _RK4_ABOVE and not scene.spheres:
        return [order8.replace(integrator="rk4"), order8]
    return [order8]
