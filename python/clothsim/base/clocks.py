"""A stopwatch, the time of a step, and the order in which works take turns."""

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


def turns(count: int, rounds: int) -> Iterator[int]:
    """Indices 0 to `count` - 1 in every round, each round in another order.

    A slow spell of the machine then affects all, and no index always follows a certain other.
    """
    order = list(range(count))
    shuffle = random.Random(0).shuffle
    for _ in range(rounds):
        shuffle(order)
        yield from order
