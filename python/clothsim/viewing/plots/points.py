"""The choice of the mass points that stand for a motion in a plot."""

from __future__ import annotations

import numpy as np

from ...base import Floats

_STILL = 0.1  # part of the largest way of a point, below which a point shows little of the motion
_MISSING = 0.5  # part of the most measured times, below which a point has too many gaps


def distant_points(x: Floats, count: int = 3) -> list[tuple[int, int]]:
    """Return (point, component) of at most `count` points that are far from each other.

    `x` [m] has the shape (times, points, 3), NaN where nothing was measured. The first point moves
    most; each further one is as far as possible from those before. The component is that in which
    the point moves most.
    """
    way = np.fmax.reduce(x, axis=0) - np.fmin.reduce(x, axis=0)  # NaN where there are no numbers
    longest = np.nan_to_num(way, nan=-1.0).max(axis=1)
    times = np.isfinite(x).all(axis=2).sum(axis=0)
    useful = (longest >= _STILL * longest.max()) & (times >= _MISSING * times.max())
    candidates = np.flatnonzero(useful & (longest >= 0))
    if not candidates.size:
        return []
    places = np.nanmean(x[:, candidates], axis=0)
    chosen = [int(longest[candidates].argmax())]
    gaps = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < count and gaps.max() > 0:
        chosen.append(int(gaps.argmax()))
        gaps = np.minimum(gaps, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return [(int(k), int(np.nan_to_num(way[k], nan=-1.0).argmax())) for k in candidates[chosen]]
