"""Moving triangles against a sphere: the core's test against the exact one."""

from __future__ import annotations

from typing import Any

import numpy as np
from clothsim import _core  # no public name tests a triangle alone

from .exact import distance, nearest_approach

_CHUNK = 4_000


def _cases(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles outside a sphere of radius 1 and where they go, about half of them through it.

    Sizes from 0.03 to 30 radii, ways from 1e-3 to 1e3 radii, flat, turning and stretching.
    """
    size = 10 ** rng.uniform(-1.5, 1.5, (count, 1, 1))
    shape = rng.normal(size=(count, 3, 3)) * size
    shape -= (rng.dirichlet((1, 1, 1), count)[:, :, None] * shape).sum(axis=1, keepdims=True)
    thin = rng.random((count, 1)) < 0.1
    shape[:, 2] = np.where(thin, shape[:, 0] + rng.uniform(-1, 2, (count, 1)) * (shape[:, 1] - shape[:, 0]), shape[:, 2])
    way = rng.normal(size=(count, 3))
    way *= 10 ** rng.uniform(-3, 3, (count, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
    aside = rng.normal(size=(count, 3)) * rng.choice((0.0, 0.5, 1.0, 2.0), (count, 1))
    through = aside - rng.uniform(0, 1, (count, 1)) * way
    p0 = shape + through[:, None]
    change = rng.normal(size=(count, 3, 3)) * size * rng.choice((0.0, 0.1, 1.0), (count, 1, 1))
    return p0, p0 + way[:, None] + change


def triangle_cases(cases: int = 10**6, seed: int = 1) -> dict[str, Any]:
    """Compare the core's test of moving triangles with `nearest_approach` on random cases.

    Parameters
    ----------
    cases : int
        Least number of tested triangles that start outside.
    seed : int

    Returns
    -------
    dict
        "cases", "touching" (triangles that come nearer than the radius by more than 1e-9) and "missed" (touching
        triangles that the core did not find).
    """
    rng = np.random.default_rng(seed)
    total = {"cases": 0, "touching": 0, "missed": 0}
    while total["cases"] < cases:
        p0, p1 = _cases(rng, _CHUNK)
        outside = distance(p0) > 1
        p0, p1 = p0[outside], p1[outside]
        least = nearest_approach(p0, p1, 1.0)
        found = ~np.isnan(_core.triangle_touches(p0, p1, 1.0, 1e-9))
        touching = least < 1 - 1e-9
        total["cases"] += len(p0)
        total["touching"] += int(touching.sum())
        total["missed"] += int((touching & ~found).sum())
    return total
