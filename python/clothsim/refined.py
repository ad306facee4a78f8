"""Runs of few oscillations: equal steps, as many as the error asks for.

Such a run has so few steps that those with which a step size controller begins and ends would be a
good part of them. Two runs in equal steps tell their errors, which are as n^-8 for n steps of
dop853, if all steps are equally hard: in one in which springs collapse the error may be that of a
single step, and no rule holds. The method's own estimates of the steps tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .frames import Floats, Schedule
from .plan import core_cloth
from .recording import Frame, Watch
from .runs import Options, Solution, integrate, rms, size_of
from .scene import Scene
from .stability.bound import guaranteed_dt

_FEW = 30.0  # radians by which the fastest mode turns at most

# The error over the size after an oscillation by the angle q in n steps is about this times
# q (q / n)^8: measured on the oscillator of `clothsim.scenes`.
_ERROR, _ORDER = 4e-9, 8

_LONGEST = 3.4  # the angle of a step at most
_RATIO = 1.5  # steps of the run that is looked for over those of the one before it
_MOST_RATIO = 4.0  # from one run to the next

# The estimate of the hardest step over the mean one at most. On cloths drawn at random, errors were
# up to 1.3 times what two runs tell below this, and up to 23 times above.
_EQUALLY_HARD = 3.0

_DOUBT = 1.5  # Estimates are taken times this.
# At the moment in which the error of an oscillation passes through 0 it is one of the velocity. So
# much of that, over the highest frequency, is added.
_PART_OF_VELOCITY = 0.5

# A run whose error is not less than this part of the goal is not taken where there is a better one.
_SURE = 0.3

_ATTEMPTS = 8


@dataclass(frozen=True)
class Refined:
    """A run and its error, and what the other runs cost."""

    solution: Solution | None  # None: its steps are not equally hard
    error: Floats  # of the last positions [m]
    evaluations: int
    wall_time: float  # [s]


def is_few(scene: Scene, duration: float) -> bool:
    """Whether the run has few oscillations."""
    return _angle(scene, duration) < _FEW


def refine(
    scene: Scene,
    duration: float,
    goal: float,
    options: Options,
    frames: Schedule | None = None,
    watch: Watch | None = None,
) -> Refined:
    """The run of dop853 in equal steps whose error is at most `goal` [m], rms."""
    angle = max(_angle(scene, duration), 1.0)
    longest = guaranteed_dt(core_cloth(scene), options.integrator)
    wanted = angle * (_ERROR * angle * size_of(scene) / goal) ** (1 / _ORDER)
    coarse = math.ceil(max(3, duration / longest, angle / _LONGEST, wanted / _RATIO))
    fine = max(coarse + 1, math.ceil(wanted))
    runs: list[Solution] = []
    chosen, error, steps = None, np.zeros_like(scene.initial_position), coarse
    for _ in range(_ATTEMPTS):
        run, equally_hard = _run(scene, duration, steps, options, frames, watch)
        runs.append(run)
        if not equally_hard:
            chosen = None
            break
        if len(runs) == 1:
            steps = fine
            continue
        before, last = runs[-2:]
        part = (before.steps / last.steps) ** _ORDER  # of the error before that the last one has
        gone, speed = before.x[-1] - last.x[-1], before.v[-1] - last.v[-1]
        error = _DOUBT / (1 - part) * np.hypot(gone, _PART_OF_VELOCITY * duration / angle * speed)
        chosen = before
        if rms(error) > _SURE * goal:
            chosen, error = last, part * error
        if rms(error) <= goal:
            break
        more = (4 * rms(error) / goal) ** (1 / _ORDER)
        steps = max(steps + 1, math.ceil(steps * min(more, _MOST_RATIO)))
    others = [run for run in runs if run is not chosen]
    return Refined(
        chosen, error, sum(run.evaluations for run in others), sum(run.wall_time for run in others)
    )


class _Estimates:
    """The method's own estimates of the steps of a run."""

    def __init__(self) -> None:
        self.wall_time = 0.0
        self.all: list[float] = []

    def steps_at_once(self, t: float, dt: float, left: int) -> int:
        return 1

    def observe(
        self, t: float, before: Frame, after: Frame, dt: float, steps: int, estimate: float
    ) -> None:
        self.all.append(estimate)

    @property
    def equal(self) -> bool:
        return max(self.all) * len(self.all) <= _EQUALLY_HARD * sum(self.all)


def _run(
    scene: Scene,
    duration: float,
    steps: int,
    options: Options,
    frames: Schedule | None = None,
    watch: Watch | None = None,
) -> tuple[Solution, bool]:
    """A run in so many steps, and whether they are equally hard."""
    estimates, any_step = _Estimates(), 1e6 * size_of(scene)
    solution = integrate(
        scene, duration, any_step, options, frames, watch, estimates, longest=duration / steps
    )
    return solution, estimates.equal


def _angle(scene: Scene, duration: float) -> float:
    return math.sqrt(core_cloth(scene).mode_bounds[0]) * duration
