"""A stopwatch, the time of a step, and the order in which works take turns."""

from __future__ import annotations

import random
from collections.abc import Iterator
from time import perf_counter


class Stopwatch:
    """A context whose attribute `seconds` is how long it took."""

    seconds: float

    def __enter__(self) -> Stopwatch:
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.seconds = perf_counter() - self._start


def turns(count: int, rounds: int) -> Iterator[int]:
    """Indices 0 to `count` - 1 in every round, each round in another order.

    A slow spell of the machine then affects all, and no index always follows a certain other.
    """
    order = list(range(count))
    shuffle = random.Random(0).shuffle
    for _ in range(rounds):
        shuffle(order)
        yield from order
