"""Clock of a run: the time of step k is counted from an origin, so that rounding does not add up."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Clock:
    """Times in s; `at(k)` has the core's bits."""

    origin: float
    steps: int = 0
    dt: float = 0.0

    def at(self, further: int) -> float:
        return self.origin + float(self.steps + further) * self.dt

    def now(self) -> float:
        return self.at(0)

    def after(self, steps: int) -> Clock:
        return replace(self, steps=self.steps + steps)

    def with_step(self, dt: float) -> Clock:
        return self if dt == self.dt else Clock(self.now(), 0, dt)
