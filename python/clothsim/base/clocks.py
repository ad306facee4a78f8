"""A stopwatch, the time of a step, steps that end in time, and the order in which works take turns."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from time import perf_counter


class Stopwatch:
    """A context whose attribute `seconds` is how long it took."""

    seconds: float

    def __enter__(self) -> Stopwatch:
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.seconds = perf_counter() - self._start


def seconds_per_step(advance: Callable[[int], object], window: float, rounds: int, most: int) -> float:
    """The least seconds per step in some rounds.

    Each round calls `advance` with the number of steps that take about `window` seconds, from 8 to `most`. Steps that fail
    end the timing; 0 if no round succeeds.
    """
    best, steps = math.inf, 8
    for _ in range(rounds):
        try:
            with Stopwatch() as watch:
                advance(steps)
        except ArithmeticError:  # a run with these steps reports it
            break
        best = min(best, watch.seconds / steps)
        steps = min(max(8, int(min(window / best, most))), most)
    return best if math.isfinite(best) else 0.0


class StepTimer:
    """Times steps in short parts, so that a time limit is kept. `advance` is called with a number of steps to take."""

    LONGEST_PART = 0.1  # s of steps between two readings of the clock

    def __init__(self, advance: Callable[[int], object]) -> None:
        self._advance, self._part = advance, 1

    def timed(self, steps: int, seconds: float) -> tuple[int, float]:
        """Steps done, at most `steps` and at least one, and how long they took [s].

        After `seconds` it ends early.
        """
        start, done, elapsed = perf_counter(), 0, 0.0
        while done < steps and (elapsed < seconds or done == 0):
            part = min(self._part, steps - done)
            begin = perf_counter()
            self._advance(part)
            took = perf_counter() - begin
            done, elapsed = done + part, perf_counter() - start
            self._part = max(1, min(2 * part, int(part * self.LONGEST_PART / max(took, 1e-9))))
        return done, elapsed


def turns(count: int, rounds: int) -> Iterator[int]:
    """Indices 0 to `count` - 1 in every round, each round in another order.

    A slow spell of the machine then affects all, and no index always follows a certain other.
    """
    order = list(range(count))
    shuffle = random.Random(0).shuffle
    for _ in range(rounds):
        shuffle(order)
        yield from order
