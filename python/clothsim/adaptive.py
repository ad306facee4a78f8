"""Error control: from an error that is asked for to a run that has it, and the estimate of it.

What is asked is the error of the positions at the end of the run, as the root of the mean square
over the mass points: ``atol + rtol * size`` with the longer side of the cloth as its size.

1. **Solution.** An adaptive method (or a fixed-step one at some time step) runs at a tolerance per
   step that is proportional to what is asked.
2. **Estimate.** Where the tolerance decides the steps of an adaptive method, a companion at 30
   times that tolerance runs too: with r the ratio of their mean steps and p the order its error is
   r^p times that of the solution, and what they differ by is r^p - 1 times it. Where stability
   decides them, and with fixed steps of a cloth, the error is carried along with the run
   (`carried`); if that comes out too large, a companion at a tenth of the tolerance decides, as it
   does for scenes of few modes, whose runs have few steps. If the error is above what is asked,
   the run is done again at a smaller tolerance.
3. **Floor.** Where the tolerance is so small that rounding may matter, a perturbed twin tells by
   how much it is magnified (`growth`): the floor below which no method comes in that precision.

After a contact no error can be told. Then a companion at a tenth of the tolerance shows how far
outcomes agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .carried import CarriedError
from .growth import growth_of_perturbations
from .integration import integrators
from .plan import core_cloth
from .runs import Floats, Options, Progress, Solution, frame_times, integrate, rms, run_fixed, size_of
from .scene import Scene
from .stability.bound import guaranteed_dt

# Tolerance per step over the error asked for. The estimate of a step's error is larger than the
# error, most of all in dop853; measured on the scenes of `clothsim.scenes` (docs/integrators.md).
_STEP_TOLERANCE = {"dop853": 15.0, "dopri5": 0.3}
# ... divided by sqrt(1 + growth / this), or by that where the growth is not known. A carried error
# may be several times too large, so that less is left to the solution then.
_HARMLESS_GROWTH = 3e4
_UNKNOWN_GROWTH = 2.0
_CARRIED = 4.0

# Of a cloth of many modes stability limits the steps down to this part of the size; the error is
# carried then.
_CARRIED_ABOVE = 1e-8
_MANY_OSCILLATIONS = 100.0  # of the fastest mode, in radians

# Of what a finer companion's error should be over the solution's, no less than this is believed.
_CAUTIOUS = 0.25

# The tolerance of a looser companion over that of the solution.
_LOOSER = 30.0

# Below this part of the size the floor of rounding may matter, and the growth is computed.
_MAY_BE_FLOOR = 1e-9

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
    every: int | float | None,
    progress: Progress = iter,
) -> Controlled:
    """The run whose error is at most `asked` [m], rms, or at the floor of rounding.

    Each of `choices` is tried once, and the last one at smaller tolerances until it does.
    """
    size, rest = size_of(scene), list(choices)
    growth, floor, spent, wall_time = None, 0.0, 0, 0.0
    if asked < _MAY_BE_FLOOR * size * (1 - 1e-9):
        found = growth_of_perturbations(scene, duration, rest[-1])
        growth, spent, wall_time = found.factor, found.evaluations, found.wall_time
        rounding = np.finfo(np.float32 if rest[-1].precision == "single" else np.float64).eps
        floor = float(rounding) * size * growth
    goal = max(asked, floor)
    options = rest.pop(0)
    method = _method(scene, duration, every, goal, growth, options)
    parameter = method.first
    for attempt in range(_ATTEMPTS):
        carried = CarriedError(scene, duration, options) if method.carries else None
        solution = method.run(parameter, options, progress, carried)
        exact = options.replace(precision="double")
        companion, part, error = None, method.companion, math.inf
        if carried:
            spent += carried.evaluations
            wall_time += carried.wall_time
            difference, error, part = carried.x, rms(carried.x), method.finer
        # A carried error may be too large where stability limits the steps: a companion decides.
        if solution.contacts or not carried or (error > goal and not rest):
            part = method.finer if solution.contacts else part
            companion = method.run(parameter * part, exact, iter, None)
            spent += companion.evaluations
            wall_time += companion.wall_time
            if solution.contacts or companion.contacts:
                return Controlled(
                    solution, companion, asked, floor, growth, None, spent, wall_time
                )
            difference = method.extrapolated(solution, companion, part)
            error = rms(difference)
        gain = max(method.gain(part), _CAUTIOUS)
        if companion and part < 1 and error > goal >= 2 * gain * error:
            # The finer companion is the solution.
            spent += solution.evaluations - companion.evaluations
            wall_time += solution.wall_time - companion.wall_time
            solution, difference = companion, difference * gain
            break
        # At the floor runs differ by rounding, whatever their tolerance.
        if error <= goal or (asked <= floor and error <= 10 * floor) or attempt == _ATTEMPTS - 1:
            break
        spent += solution.evaluations
        wall_time += solution.wall_time
        progress = iter
        if rest:
            options = rest.pop(0)
            method = _method(scene, duration, every, goal, growth, options)
            parameter = method.first
        else:
            parameter = method.better(parameter, goal / error)
            options = exact
    return Controlled(solution, None, asked, floor, growth, difference, spent, wall_time)


def _method(
    scene: Scene,
    duration: float,
    every: int | float | None,
    goal: float,
    growth: float | None,
    options: Options,
) -> _Adaptive | _Fixed:
    if integrators()[options.integrator].adaptive:
        return _Adaptive(scene, duration, every, goal, growth, options)
    return _Fixed(scene, duration, every, goal, options)


def _many_modes(scene: Scene, duration: float) -> bool:
    stiffness, _ = core_cloth(scene).mode_bounds
    return math.sqrt(stiffness) * duration >= _MANY_OSCILLATIONS


class _Adaptive:
    """Runs of an adaptive method; the parameter is the tolerance of a step [m]."""

    finer = 0.1  # the parameter of a better run over that of another

    def __init__(
        self,
        scene: Scene,
        duration: float,
        every: int | float | None,
        goal: float,
        growth: float | None,
        options: Options,
    ) -> None:
        self._scene, self._duration, self._every = scene, duration, every
        self._order = integrators()[options.integrator].order
        part = goal / size_of(scene) * (1 + 1e-9)
        many = _many_modes(scene, duration)
        self.carries = many and part >= _CARRIED_ABOVE
        # Runs of few modes have so few steps that orders hardly show.
        self.companion = _LOOSER if many else self.finer
        factor = _STEP_TOLERANCE[options.integrator]
        if self.carries:
            factor /= _CARRIED
        elif growth is not None:
            factor /= math.sqrt(1.0 + growth / _HARMLESS_GROWTH)
        elif self.companion > 1:
            factor /= _UNKNOWN_GROWTH
        self.first = goal * factor

    def run(
        self, tolerance: float, options: Options, progress: Progress, error: CarriedError | None
    ) -> Solution:
        return integrate(
            self._scene, self._duration, tolerance, options, self._every, progress, error
        )

    def gain(self, part: float) -> float:
        """The error at that part of a tolerance over that at the whole."""
        return part

    def extrapolated(self, solution: Solution, companion: Solution, part: float) -> Floats:
        """The error of the last positions, by a run at that part of the tolerance."""
        difference = solution.x[-1] - companion.x[-1]
        if part < 1:
            return difference / (1 - part)
        ratio = solution.steps / companion.steps
        return difference / max(ratio**self._order - 1, 1.0)

    def better(self, tolerance: float, ratio: float) -> float:
        return tolerance * min(0.5, ratio / 2)


class _Fixed:
    """Runs of a fixed-step method; the parameter is the time step [s]."""

    finer = companion = 0.5

    def __init__(
        self,
        scene: Scene,
        duration: float,
        every: int | float | None,
        goal: float,
        options: Options,
    ) -> None:
        self.order = integrators()[options.integrator].order
        self.carries = _many_modes(scene, duration)
        # The error of a method of order 1 is too large at its limit to try it, unless it is forgotten.
        near = 0.75 if self.order == 1 and not _forgets(scene, duration, goal) else 0.95
        longest = near * guaranteed_dt(core_cloth(scene), options.integrator)
        self.first = duration / max(4, math.ceil(duration / longest))
        self._scene, self._duration = scene, duration
        # An int counts the steps of the first run, so that all runs have the same frames.
        between = duration if every is None else every * self.first if isinstance(every, int) else every
        self._times = frame_times(duration, between)

    def run(
        self, dt: float, options: Options, progress: Progress, error: CarriedError | None
    ) -> Solution:
        return run_fixed(
            self._scene, self._duration, dt, options, self._times, progress, error=error
        )

    def gain(self, part: float) -> float:
        """The error at that part of a step over that at the whole."""
        return float(part**self.order)

    def extrapolated(self, solution: Solution, companion: Solution, part: float) -> Floats:
        """The error of the last positions, by a run at that part of the step."""
        return (solution.x[-1] - companion.x[-1]) / (1 - self.gain(part))

    def better(self, dt: float, ratio: float) -> float:
        return dt * min(self.finer, (ratio / 2) ** (1 / self.order))


# Above this part of the size an undamped scene is cheapest with PEFRL, and a cloth of many modes,
# whose step stability limits, with the semi-implicit Euler method; the latter in single.
_PEFRL_ABOVE = 1e-5
_EULER_ABOVE = 3e-4

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
    euler = order8.replace(integrator="semi_implicit_euler")
    if damping == 0 and part >= _PEFRL_ABOVE:
        return [order8.replace(integrator="pefrl"), order8]
    if not _many_modes(scene, duration):
        return [order8]
    if part >= _EULER_ABOVE:
        single = "double" if options.strict else "single"
        return [euler.replace(precision=single), order8]
    if _forgets(scene, duration, asked):
        return [euler, order8]
    return [order8]
