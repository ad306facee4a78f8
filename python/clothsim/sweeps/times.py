"""Times of a run's frames, and the steps between them, as in `simulate` with a given step."""

from __future__ import annotations

import math

# A remainder below this part of a step is rounding of the caller's numbers, not a step.
_NEGLIGIBLE = 1e-9


def frame_times(duration: float, dt: float, every: int | float | None) -> list[float]:
    """Times of the frames: 0, each multiple of `every` before the end, and the end."""
    if every is None:
        return [0.0, duration]
    between = every * dt if isinstance(every, int) else every
    count = math.ceil(duration / between - _NEGLIGIBLE)
    return [k * between for k in range(count)] + [duration]


def pieces(begin: float, end: float, dt: float) -> list[tuple[int, float]]:
    """Numbers and lengths of the steps from `begin` to `end`: whole steps, then the rest."""
    whole = math.floor((end - begin) / dt + _NEGLIGIBLE)
    rest = (end - begin) - whole * dt
    found = [(whole, dt)] if whole else []
    return found + ([(1, rest)] if rest > _NEGLIGIBLE * dt else [])
