"""The clock of a run, and the last state that was copied back, which outlives the adapter."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Clock:
    """Times in s, with the core's bits: that of step k is counted from an origin, so that rounding does not add up."""

    origin: float
    steps: int = 0
    dt: float = 0.0

    def at(self, further: int) -> float:
        return self.origin + float(self.steps + further) * self.dt

    def now(self) -> float:
        return self.at(0)

    def after(self, steps: int) -> Clock:
        return replace(self, steps=self.steps + steps)


# The state is copied back this often, as long as that takes no more than this part of the time.
SECONDS_BETWEEN_COPIES = 1.0
PART_OF_TIME_FOR_COPIES = 0.02


class SafeCopy:
    """A copy of the state in host memory, in the form of `planes.split`, with its clock; copying it back `took` seconds."""

    def __init__(self, parts: Sequence[np.ndarray], clock: Clock, took: float = 0.0) -> None:
        self.parts, self.clock = list(parts), clock
        self._took, self._made = took, time.monotonic()

    @property
    def is_old(self) -> bool:
        """Whether the next copy is due."""
        least = max(SECONDS_BETWEEN_COPIES, self._took / PART_OF_TIME_FOR_COPIES)
        return time.monotonic() - self._made > least
