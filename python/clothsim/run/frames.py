"""The moments at which a run stores frames."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import check
from ..typing import Every

Moment = tuple[float, float]  # seconds since the start of the run, and the time of the scene [s]

# A remainder below this part of a step is rounding of the caller's numbers, not a step.
NEGLIGIBLE = 1e-9

_BYTES_PER_POINT = 48  # of a frame: position and velocity, three doubles each


@dataclass(frozen=True)
class Schedule:
    """The choice of frames between the first and the last state; by default there are none. At most one field is set."""

    steps: int | None = None  # between frames
    seconds: float | None = None  # between frames
    per_second: float | None = None
    times: tuple[float, ...] = ()  # of the scene [s], increasing

    @classmethod
    def of_every(cls, every: int | float | None) -> Schedule:
        """The schedule for steps (int) or seconds (float) between frames; see `checked_every`."""
        return cls(steps=every) if isinstance(every, int) else cls(seconds=every)

    def in_seconds(self, dt: float | None) -> Schedule:
        """An equal schedule in seconds, for steps of `dt`."""
        return self if self.steps is None or dt is None else replace(self, steps=None, seconds=self.steps * dt)

    def moments(self, start: float, end: float, begin: float = 0.0) -> list[Moment]:
        """Moments from `begin` to `end`, both included.

        `begin` and `end` are seconds since the run started, at the time `start`. Frames that are
        counted in steps have no moments here.
        """
        inner = [(t - start, t) for t in self.times]
        if self.seconds or self.per_second:
            first = math.floor(self._count(begin) + NEGLIGIBLE) + 1
            numbers = range(first, math.ceil(self._count(end) - NEGLIGIBLE))
            offsets = [k * self.seconds if self.seconds else k / (self.per_second or 1.0) for k in numbers]
            inner = [(offset, start + offset) for offset in offsets]
        near = NEGLIGIBLE * (end - begin) if self.times else 0.0
        inner = [moment for moment in inner if begin + near < moment[0] < end - near]
        return [(begin, start + begin), *inner, (end, start + end)]

    def check_memory(self, duration: float, dt: float | None, points: int) -> None:
        """Raise a ValueError where the frames of so many mass points need more memory than this machine has."""
        count = self.in_seconds(dt)._count(duration)
        needed, memory = count * points * _BYTES_PER_POINT, _memory()
        if needed > memory:
            name, advice = ("fps", "a smaller fps") if self.per_second else ("every", "a larger every")
            raise ValueError(
                f"{name} asks for {count:,.0f} frames, which need {needed / 1e9:.3g} GB; "
                f"this machine has {memory / 1e9:.3g} GB: take {advice}"
            )

    def _count(self, offset: float) -> float:
        return offset / self.seconds if self.seconds else offset * (self.per_second or 0.0)


def _memory() -> float:
    """The memory of this machine [bytes]; infinite where the system does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def schedule(every: Any, times: Any, fps: Any, start: float, duration: float) -> Schedule:
    """The schedule for the arguments of `simulate`."""
    given = [name for name, value in (("every", every), ("times", times), ("fps", fps)) if value is not None]
    if len(given) > 1:
        raise ValueError(f"at most one of every, times and fps can be given, got {' and '.join(given)}")
    if fps is not None:
        fps = check.number("fps", fps, minimum=0, exclusive=True)
        check.frame_count("fps", fps, duration * fps)
        return Schedule(per_second=fps)
    if times is not None:
        return Schedule(times=_checked_times(times, start, duration))
    every = checked_every(every)
    if isinstance(every, float):
        check.frame_count("every", every, duration / every)
    return Schedule.of_every(every)


def checked_every(every: Any) -> int | float | None:
    """Check `every`, and return steps (int; 1 for "step"), seconds (float) or None."""
    if every is None:
        return None
    if isinstance(every, str) and every == "step":
        return 1
    if isinstance(every, (float, np.floating)):
        return check.number("every", every, minimum=0, exclusive=True)
    accepted = "steps between frames (an int >= 2), seconds between frames (a float > 0) or 'step' (each step)"
    if isinstance(every, str):
        raise TypeError(f"every must be {accepted}, got {check.shown(every)}")
    steps = check.integer("every", every)
    if steps == 1:
        raise ValueError(
            "every=1 is ambiguous: give every='step' for a frame at each step, or every=1.0 for "
            "a frame each second; an int >= 2 counts steps"
        )
    if steps < 1:
        raise ValueError(f"every must be {accepted}, got {check.shown(every)}")
    return steps


def as_every(every: int | float | None) -> Every | None:
    """The inverse of `checked_every`: the argument that gives `every`."""
    return "step" if isinstance(every, int) and every == 1 else every


def _checked_times(times: Any, start: float, duration: float) -> tuple[float, ...]:
    end = start + duration
    accepted = f"increasing times [s] from {start:g} to {end:g}"
    given = check.as_array("times", times, accepted)
    if given.ndim != 1 or not given.size:
        raise ValueError(f"times must be {accepted}, in one dimension, got shape {given.shape}")
    found = given.astype(np.float64)
    slack = NEGLIGIBLE * duration
    rising = np.append(True, found[1:] > found[:-1])
    check.check_all("times", found, rising & (found >= start - slack) & (found <= end + slack), accepted)
    return tuple(found.tolist())
