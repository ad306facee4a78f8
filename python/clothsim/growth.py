"""How small perturbations grow along a run, by a perturbed twin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .errors import UnstableError
from .runs import Options, advance_to, perturbation, rms, size_of
from .scene import Scene
from .stiffest import Stiffest

_PERTURBATION = 1e-8  # of the size
_SAFETY = 0.9  # of the step that is stable
_CHECKS = 16  # times at which the perturbed twin is compared


@dataclass(frozen=True)
class Growth:
    """By how much a small perturbation grew at most, between any two times of the run."""

    factor: float
    evaluations: int
    wall_time: float  # [s]


def growth_of_perturbations(scene: Scene, duration: float, options: Options) -> Growth:
    """The growth of a random perturbation of the positions, by a perturbed twin run.

    Both run by the semi-implicit Euler method near the limit at which it is stable about the start,
    the cheapest there is: a factor is wanted, not a solution.
    """
    start = time.perf_counter()
    options = options.replace(integrator="semi_implicit_euler", precision="double")
    stiffest = Stiffest(scene, options)
    dt = min(_SAFETY * stiffest.limit(options.integrator), duration / 4)
    x, v = scene.initial_position, scene.initial_velocity
    size = _PERTURBATION * size_of(scene)
    twin = x + perturbation(scene, size)
    twins = options.state(scene, np.stack([x, twin]), np.stack([v, v]))
    twins.warned = True  # the step is not the caller's
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
    return Growth(most, 2 * steps + stiffest.evaluations, time.perf_counter() - start)
