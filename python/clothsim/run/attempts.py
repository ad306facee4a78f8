"""The runs of one call with error control: their errors as estimated, what they cost, and what is left."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base import Floats
from ..errors import UnstableError
from ..methods.bound import usable_dt
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .fixed_steps import RunOptions, integrate, run_fixed, size_of
from .frames import Schedule
from .recording import Recording, Solution, Watch

NOT_ASKED = "no estimate was asked for"
MANY_STEPS = 1_000_000  # a fixed-step method takes no more to reach a tolerance


@dataclass
class Estimate:
    """An error of the last positions [m], over the mass points; NaN if it is unknown.

    `reason`: why it is unknown, or why it is larger than what was asked for.
    """

    max: float
    rms: float
    reason: str = ""

    @classmethod
    def of(cls, x: Floats, better: Floats, factor: float) -> Estimate:
        """`factor` times the distance of positions from better ones, and half a unit in the last place."""
        distances = factor * np.linalg.norm(x - better, axis=-1) + np.spacing(np.abs(x).max()) / 2
        return cls(float(distances.max()), float(np.sqrt((distances**2).mean())))

    @classmethod
    def unknown(cls, reason: str) -> Estimate:
        return cls(math.nan, math.nan, reason)

    def because(self, reason: str) -> Estimate:
        return Estimate(self.max, self.rms, reason)


@dataclass
class Controlled:
    """A solution, its error, and what everything else has cost."""

    solution: Solution
    error: Estimate
    evaluations: int
    wall_time: float  # [s]


# Each constant is a ratio, found on the scenes of `benchmarks/error_control.py --stream tune`.
# docs/dev/error-control.md has the effect of half and twice of each.

# Part of the run from which the number of steps is estimated.
PILOT = 0.05
# Estimates are taken times this, and proportional is what differs by less.
MARGIN = 1.4
# Local errors of a better run are neglected below this part of an error.
SMALL = 0.1
# Runs of one method at most.
RUNS = 8
# The smallest tolerance of a step, over the size: some fifty roundings of a position in double. Single
# precision keeps what a step adds with fewer digits, and compensates the sum.
SMALLEST = {"double": 1e-14, "single": 1e-8}
# Below this error over the size, rounding may be a part of a difference, and does not fall with m.
ROUNDING = 1e-9

ORDER = 8  # of dop853
# A promise, not a setting: force evaluations of everything over those of a run at the smallest tolerance.
MOST = 3.0


class Why:
    """Why an error is unknown, or larger than what was asked for."""

    CONTACT = "a sphere responded: nearby trajectories part, and no error can be told"
    MISSED = "this run misses a sphere that a better run meets: no error can be told"
    LEAST = f"runs with more steps come no closer to each other, or cost more than {MOST:g} runs at the smallest tolerance"
    UNSTABLE = "runs with more steps are unstable"
    NOT_REACHED = f"{RUNS} runs did not reach the error that was asked for"
    NO_FINER = f"neither the smallest tolerance of a step nor {MANY_STEPS:,} steps reach the error that was asked for"


class Attempts:
    """The runs of one call, and what they cost."""

    def __init__(self, scene: Scene, duration: float, options: RunOptions, watch: Watch) -> None:
        self.scene, self.duration, self.options = scene, duration, options
        self._watch = watch
        scene.stops(options.start, options.start + duration)  # refuses too many
        self._done: list[Solution] = []
        self._finished: Recording | None = None

    def adaptive(
        self,
        tolerance: float,
        frames: Schedule | None = None,
        given: list[float] | None = None,
        options: RunOptions | None = None,
    ) -> Solution:
        """A run with error control; without frames no callback follows it.

        If it runs away at the tolerance, because stiff motion is let grow up to it, it is done
        again at a smaller one.
        """
        options = options or self.options
        smallest = self.smallest(options)
        tolerance = max(tolerance, smallest)
        followed = frames, None if frames is None else self._watch
        while True:
            try:
                run = integrate(self.scene, self.duration, tolerance, options, *followed, given=given)
                return self._add(run)
            except UnstableError:
                if given is not None or tolerance <= smallest:
                    raise
            tolerance = max(SMALL**3 * tolerance, smallest)

    def smallest(self, options: RunOptions) -> float:
        """The smallest tolerance of a step [m]."""
        return SMALLEST[options.precision] * size_of(self.scene)

    def steps_ahead(self, tolerance: float) -> float:
        """Steps of a run with error control, from the first part of it."""
        watch, tolerance = Watch(), max(tolerance, self.smallest(self.options))
        try:
            run = integrate(self.scene, PILOT * self.duration, tolerance, self.options, watch=watch)
        except UnstableError:
            return 0.0
        except KeyboardInterrupt:
            self._watch.recording = watch.recording or self._watch.recording
            raise
        self._done.append(run)
        return run.steps / PILOT

    def longest_dt(self, integrator: str) -> float:
        """The longest fixed step [s]: the guaranteed stable one, or half of it in a scene with spheres."""
        stable = usable_dt(core_cloth(self.scene.cloth), integrator)
        return min(stable / 2 if self.scene.spheres else stable, self.duration / 4)

    def fixed(self, dt: float, frames: Schedule, options: RunOptions | None = None) -> Solution:
        """A run at a time step that is not the caller's."""
        dt, options = self.duration / math.ceil(self.duration / dt), options or self.options
        return self._add(run_fixed(self.scene, self.duration, dt, options, frames, self._watch, own_step=True).solution())

    def add(self, run: Solution) -> None:
        self._done.append(run)

    @property
    def spent(self) -> int:
        """Force evaluations of the runs so far."""
        return sum(run.evaluations for run in self._done)

    def _add(self, run: Solution) -> Solution:
        self._done.append(run)
        self._finished = self._watch.recording
        return run

    def hand_over(self) -> None:
        """Let the last run that came to its end be what is handed over."""
        if self._finished is not None:
            self._watch.recording = self._finished

    def close(self, solution: Solution, error: Estimate) -> Controlled:
        others = [run for run in self._done if run is not solution]
        return Controlled(solution, error, sum(run.evaluations for run in others), sum(run.wall_time for run in others))
