"""The error of a run, carried along with it.

An error e obeys, as long as it is small, the equation of a small perturbation of the trajectory,

    e'' = (da/dx) e + (da/dv) e' + what each step adds

so that one vector, carried along the run, becomes the error at its end (Hairer, Norsett, Wanner,
Solving Ordinary Differential Equations I, section II.12 has the equation). What a step adds is
found by doing it again in two halves, in double; a few steps of a run are, and stand for the
others. The carrying needs no precision, so a cheap method does it, with the derivatives taken once
a block of steps, at the longest substep that is stable at the states that the run comes through.
"""

from __future__ import annotations

import math
import time
from collections import deque

import numpy as np

from .integration import integrators
from .runs import Floats, Frame, Options, size_of
from .scene import Scene
from .stiffest import Stiffest

# Steps done again: at least this many a run, and one of so many at the least and the most.
_SAMPLES = 6
_FEWEST_STEPS, _MOST_STEPS = 3, 60

# The damping of what no error grows by need not be followed in full: so much of it is left, over
# the highest frequency, that substeps stay long.
DAMPING = 0.6
_SAFETY = 0.95  # of the substep that is stable
_BLOCK = 5  # substeps with the same derivatives
_BLOCKS_BETWEEN = 10  # looks at what is stiffest
_FEWEST_SUBSTEPS = 16  # of a run: few if its fastest motion is slow, and then that has to be followed

_DISPLACEMENT = 1e-7  # of the size, by which derivatives are taken


class CarriedError:
    """The error of the run that `observe` is told of.

    Attributes
    ----------
    x : numpy.ndarray
        Error of the positions [m] so far.
    wall_time : float
        Seconds it took.
    block : float
        Time [s] over which derivatives are kept.

    Parameters
    ----------
    scene, duration, options
        Of the run.
    stiffest : Stiffest, optional
        Of the scene, where it is known.
    damping : float
        The damping rate that is followed at most, over the highest frequency.
    """

    def __init__(
        self,
        scene: Scene,
        duration: float,
        options: Options,
        stiffest: Stiffest | None = None,
        damping: float = DAMPING,
    ) -> None:
        begin = time.perf_counter()
        free = scene.replace(spheres=())
        exact = options.replace(precision="double")
        self._field = exact.replace(integrator="rk4").state(free)
        self._fine = exact.state(free)
        self._fine.core.set_stable_dt([math.inf])  # the run itself is watched
        self._halving = 1 - 0.5 ** integrators()[options.integrator].order
        self._duration = duration
        self._damping = damping
        self._looked = stiffest.evaluations if stiffest else 0
        self._stiffest = stiffest or Stiffest(scene, options)
        self._blocks = 0
        self.block = min(_BLOCK * self._substep()[0], duration / 4)
        self._displacement = _DISPLACEMENT * size_of(scene)
        self._next_sample = 0.0
        self.x, self._v = (np.zeros_like(scene.initial_position) for _ in "xv")
        self._begin: Frame | None = None  # of what is not carried yet, and how long that is [s]
        self._passed = 0.0
        self._better: Frame | None = None  # the end of the step before, by two halves
        self._weight = 0.0  # of its error
        self._estimates: deque[float] = deque(maxlen=_MOST_STEPS)  # of the steps before
        self._evaluations = self._counted = 0
        self.wall_time = time.perf_counter() - begin

    @property
    def evaluations(self) -> int:
        """Force evaluations it took."""
        return self._evaluations + self._stiffest.evaluations - self._looked

    def steps_at_once(self, t: float, dt: float, left: int) -> int:
        if t >= self._next_sample or left == 1 or self._better is not None:
            return 1
        until_sample = math.ceil((self._next_sample - t) / dt)
        return max(1, min(left - 1, until_sample, int(self.block / 2 / dt)))

    def observe(
        self, t: float, before: Frame, after: Frame, dt: float, steps: int, estimate: float
    ) -> None:
        last = t + steps * dt > self._duration - dt / 2
        due = t >= self._next_sample and steps == 1 and not last
        if self._begin is None:
            self._begin = before
        if self._better is not None:
            # One step further on, by when what is stiff of the error has faded, it is added.
            for total, part in zip((self.x, self._v), self._against(self._better, after, dt, 1)):
                total += self._weight * part
        self._better = None
        self._estimates.append(estimate)
        self._passed += steps * dt
        if last or due or self._passed + steps * dt > self.block * (1 + 1e-9):
            self._carry(after)
        if due:
            self._sample(t, before, dt, estimate)
        if last:
            self.x += self._against(before, after, dt / 2, 2)[0] / self._halving

    def _sample(self, t: float, before: Frame, dt: float, estimate: float) -> None:
        """Do a step again in two halves; its error is to count for the steps until the next one."""
        every = min(max(self._duration / dt / _SAMPLES, _FEWEST_STEPS), _MOST_STEPS)
        self._next_sample = t + every * dt * (1 - 1e-9)
        # The last step is done again for itself.
        weight = min(every, (self._duration - t) / dt - 1)
        usual = sum(self._estimates) / len(self._estimates)
        if 0 < estimate < math.inf:
            # A step with a small estimate is the exception: it is not blown up to the usual size.
            weight *= min(usual / estimate, 1.0)
        self._weight = weight / self._halving
        self._better = self._again(before, dt / 2, 2)

    def _again(self, begin: Frame, dt: float, steps: int) -> Frame:
        core, end = self._fine.core, (np.empty_like(self.x), np.empty_like(self.x))
        core.load(*begin)
        core.advance(steps, dt, self._fine.threads, self._fine.threads_optional)
        core.store(*end)
        counted = core.evaluations[0]
        cost = 4 * steps if self._fine.integrator == "rk4" else counted - self._counted
        self._counted = counted
        self._evaluations += cost
        return end

    def _against(self, begin: Frame, end: Frame, dt: float, steps: int) -> Frame:
        """What `end` has more than so many steps from `begin`."""
        x, v = self._again(begin, dt, steps)
        return end[0] - x, end[1] - v

    def _carry(self, end: Frame) -> None:
        """Carry the error on to `end`, by derivatives half way, where a cubic has the state."""
        h, (x0, v0), (x1, v1) = self._passed, self._begin, end
        x = (x0 + x1) / 2 + h / 8 * (v0 - v1)
        v = 1.5 / h * (x1 - x0) - (v0 + v1) / 4
        self._blocks += 1
        if self._blocks % _BLOCKS_BETWEEN == 0:
            self._stiffest.look(x, v)
        longest, part = self._substep()
        substeps = max(1, math.ceil(h / longest))
        self._field.core.carry(
            x, v, self.x, self._v, h, substeps, part, self._displacement, self._field.threads
        )
        self._evaluations += substeps + 1
        self._begin, self._passed = end, 0.0

    def _substep(self) -> tuple[float, float]:
        """The longest [s], and the part of the damping that goes with it."""
        here = self._stiffest
        part = min(1.0, self._damping * here.omega / here.delta) if here.delta and here.omega else 1.0
        stable = _SAFETY * here.limit("semi_implicit_euler", part)
        return min(stable, self._duration / _FEWEST_SUBSTEPS), part
