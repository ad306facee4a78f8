"""Timed steps that end in time."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter


class StepTimer:
    """Times steps in parts that are short enough to end in time.

    Parameters
    ----------
    advance : callable
        Called with a number of steps, which it takes.
    """

    LONGEST_PART = 0.1  # s of steps between two looks at the clock

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
