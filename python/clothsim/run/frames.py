"""When frames of a run are stored."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..base import check

# A remainder below this part of a step is rounding of the caller's numbers, not a step.
NEGLIGIBLE: float = _core.heuristics["negligible_step"]
_MOST_FRAMES = 10_000_000  # Their times alone take 1 GB.


@dataclass(frozen=True)
class Frames:
    """When frames are stored between the first and the last state; by default there are none. At
    most one field is set.
    """

    every: int | float | None = None  # steps (int) or seconds (float) between frames
    fps: float | None = None
    times: tuple[float, ...] = ()  # of the scene [s], increasing

    @classmethod
    def from_arguments(
        cls, every: Any, times: Any, fps: Any, start: float, duration: float
    ) -> Frames:
        """Check the arguments of `simulate`, and return their frames."""
        names = [
            name
            for name, value in (("every", every), ("times", times), ("fps", fps))
            if value is not None
        ]
        if len(names) > 1:
            raise ValueError(
                f"at most one of every, times and fps can be given, got {' and '.join(names)}"
            )
        if times is not None:
            return cls(times=_checked_times(times, start, duration))
        if fps is not None:
            fps = check.number("fps", fps, minimum=0, exclusive=True)
        return cls(checked_frame_interval(every), fps)

    @property
    def steps_between(self) -> int:
        """Steps between frames; 0 where they are not counted in steps."""
        return self.every if isinstance(self.every, int) else 0

    def moments_between(
        self, start: float, begin: float, end: float, dt: float | None
    ) -> list[_core.Moment]:
        """Return the moments from `begin` to `end`, both included, of steps of `dt`.

        Without it frames that are counted in steps have no moments. `begin` and `end` are seconds
        since the run started, at the time `start`.
        """
        every = self.steps_between * (dt or 0.0) if self.steps_between else self.every
        if self.times:
            near = NEGLIGIBLE * (end - begin)
            inner = [
                _core.Moment(t - start, t)
                for t in self.times
                if begin + near < t - start < end - near
            ]
        else:
            first, last = (
                offset / every if every else offset * (self.fps or 0.0) for offset in (begin, end)
            )
            if not last - first < _MOST_FRAMES:
                name = "fps" if self.fps else "every"
                raise ValueError(
                    f"{name} must give fewer than {_MOST_FRAMES:,} frames, got "
                    f"{self.fps or self.every:g}"
                )
            numbers = range(math.floor(first + NEGLIGIBLE) + 1, math.ceil(last - NEGLIGIBLE))
            offsets = [k * every if every else k / (self.fps or 1.0) for k in numbers]
            inner = [_core.Moment(offset, start + offset) for offset in offsets]
        first_moment = _core.Moment(begin, start + begin)
        return [first_moment, *inner, _core.Moment(end, start + end)]


def checked_frame_interval(every: Any) -> int | float | None:
    """Check `every`: steps (int) or seconds (float)."""
    if isinstance(every, (int, np.integer)):
        return check.integer("every", every, minimum=1)
    return None if every is None else check.number("every", every, minimum=0, exclusive=True)


def _checked_times(times: Any, start: float, duration: float) -> tuple[float, ...]:
    end = start + duration
    accepted = f"increasing times [s] from {start:g} to {end:g}"
    array = check.as_array("times", times, accepted)
    if array.ndim != 1 or not array.size:
        raise ValueError(f"times must be {accepted}, in one dimension, got shape {array.shape}")
    array = array.astype(np.float64)
    slack = NEGLIGIBLE * duration
    rising = np.append(True, array[1:] > array[:-1])
    within = (array >= start - slack) & (array <= end + slack)
    check.check_all("times", array, rising & within, accepted)
    return tuple(array.tolist())
