"""The timer of the benchmarks: short windows of works in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import clothsim as cs
import numpy as np
from common import turns


class Work:
    """Something whose steps can be timed."""

    cold_steps: int | None = None
    """Steps of a window that begins right after `prepare`, with nothing run in between. None: as
    many as fill the window, after a quarter of them untimed."""

    def prepare(self) -> None:
        """Called before each window, untimed."""

    def run(self, steps: int) -> None:
        """Do `steps` steps."""
        raise NotImplementedError


class Steps(Work):
    """Steps of a stepper that `make` makes anew for each window, or one that goes on.

    Parameters
    ----------
    stepper : clothsim.Stepper or callable
        A callable makes the stepper of each window, untimed.
    dt : float
        Time step [s].
    steps : int
        Of a window.
    """

    def __init__(self, stepper: cs.Stepper | Callable[[], cs.Stepper], dt: float, steps: int) -> None:
        self._make, self._dt, self.cold_steps = stepper, dt, steps

    def prepare(self) -> None:
        self._stepper = self._make() if callable(self._make) else self._make

    def run(self, steps: int) -> None:
        self._stepper.advance(steps, self._dt)


@dataclass(frozen=True)
class Timing:
    """Seconds per step over the windows, and how many steps a window had."""

    minimum: float
    median: float
    windows: int
    steps: int


def calibrate(work: Work, seconds: float, clock: Callable[[], float] = perf_counter) -> int:
    """Steps that take about `seconds`, by the best of three tries each."""
    work.run(1)  # the first call pays for what is made lazily

    def once(steps: int) -> float:
        start = clock()
        work.run(steps)
        return clock() - start

    steps = 1
    while True:
        took = once(steps)
        if took >= 0.8 * seconds:  # or did something else have the processor?
            took = min(took, once(steps), once(steps)) if took < 100 * seconds else took
        if took >= 0.8 * seconds:
            return steps
        wanted = math.ceil(steps * seconds / took) if took > 0 else 10 * steps
        steps = max(steps + 1, min(10 * steps, wanted))


def measure(
    works: Sequence[Work],
    windows: int,
    seconds: float = 0.0,
    clock: Callable[[], float] = perf_counter,
    advance: Callable[[int], object] = lambda windows: None,
) -> list[Timing]:
    """Time every work in `windows` windows of about `seconds`.

    The works take `turns`. Before each window an untimed quarter of it runs, at least a step, which wakes threads and
    fills the caches. A work with `cold_steps` is an exception: its windows have exactly this number of steps.

    Parameters
    ----------
    works : sequence of Work
    windows : int
        Rounds, >= 1.
    seconds : float
        Length of a window [s], of works without `cold_steps`.
    clock : callable
        Gives the time [s].
    advance : callable
        Called with 1 after each window.

    Returns
    -------
    list of Timing
        In the order of `works`.
    """
    steps = []
    for work in works:
        work.prepare()
        if work.cold_steps is None:
            steps.append(calibrate(work, seconds, clock))
        else:
            work.run(work.cold_steps)  # the first call pays for what is made lazily
            steps.append(work.cold_steps)
    taken: list[list[float]] = [[] for _ in works]
    for k in turns(len(works), windows):
        works[k].prepare()
        if works[k].cold_steps is None:
            works[k].run(max(1, steps[k] // 4))
        start = clock()
        works[k].run(steps[k])
        taken[k].append((clock() - start) / steps[k])
        advance(1)
    return [Timing(min(row), float(np.median(row)), windows, count) for row, count in zip(taken, steps, strict=True)]
