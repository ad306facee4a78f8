"""The timer of the benchmarks: short windows of works in turn."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import clothsim as cs
import numpy as np


class Work:
    """Something whose steps can be timed."""

    window_steps: int | None = None
    """Steps of a window that begins right after `prepare`. None: as many as fill it, after a
    quarter of them untimed.
    """

    def prepare(self) -> None:
        """Prepare a window, untimed."""

    def run(self, steps: int) -> None:
        raise NotImplementedError


class Steps(Work):
    """Windows of `steps` steps of `dt` [s], of a stepper that goes on, or of those that the
    callable `stepper` makes.
    """

    def __init__(
        self, stepper: cs.Stepper | Callable[[], cs.Stepper], dt: float, steps: int
    ) -> None:
        self._make = stepper
        self._dt = dt
        self.window_steps = steps

    def prepare(self) -> None:
        self._stepper = self._make() if callable(self._make) else self._make

    def run(self, steps: int) -> None:
        self._stepper.advance(steps, self._dt)


@dataclass(frozen=True)
class Timing:
    """Seconds per step over the windows."""

    minimum: float
    median: float
    spread: float  # interquartile range over the minimum


def _steps_that_take(work: Work, seconds: float) -> int:
    """Return steps that take about `seconds`, by the best of three tries."""
    steps = 1
    while True:
        took = min(_seconds(work, steps) for _ in range(3))
        if took >= 0.8 * seconds:
            return steps
        steps = max(steps + 1, min(10 * steps, math.ceil(steps * seconds / max(took, 1e-9))))


def _seconds(work: Work, steps: int) -> float:
    start = perf_counter()
    work.run(steps)
    return perf_counter() - start


def measure(works: Sequence[Work], windows: int, seconds: float = 0.0) -> list[Timing]:
    """Time each work in `windows` windows of about `seconds`, in turns.

    Each round has another order, so that a slow spell of the machine meets all works. An untimed
    quarter of a window precedes it, which wakes threads and fills caches.
    """
    steps = []
    for work in works:
        work.prepare()
        work.run(work.window_steps or 1)  # the first call pays for what is made lazily
        steps.append(work.window_steps or _steps_that_take(work, seconds))
    durations: list[list[float]] = [[] for _ in works]
    order = list(range(len(works)))
    shuffle = random.Random(0).shuffle
    for _ in range(windows):
        shuffle(order)
        for k in order:
            works[k].prepare()
            if works[k].window_steps is None:
                works[k].run(max(1, steps[k] // 4))
            durations[k].append(_seconds(works[k], steps[k]) / steps[k])
    return [timing_of(row) for row in durations]


def timing_of(seconds: Sequence[float]) -> Timing:
    lower, median, upper = np.quantile(seconds, (0.25, 0.5, 0.75)).tolist()
    return Timing(min(seconds), median, (upper - lower) / min(seconds))
