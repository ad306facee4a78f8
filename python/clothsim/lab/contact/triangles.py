"""Moving triangles against a sphere: the core's test against an independent exact one."""

from __future__ import annotations

from typing import Any

import numpy as np

from clothsim import _core

_CHUNK = 4_000


def _polynomial_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of polynomials, coefficients along the last axis, lowest first."""
    out = np.zeros((*np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), a.shape[-1] + b.shape[-1] - 1))
    for i in range(a.shape[-1]):
        out[..., i : i + b.shape[-1]] += a[..., i, None] * b
    return out


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a . b for vectors (n, 3, coefficients)."""
    return np.asarray(_polynomial_product(a, b).sum(axis=-2))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    parts = [
        _polynomial_product(a[:, i], b[:, j]) - _polynomial_product(a[:, j], b[:, i]) for i, j in ((1, 2), (2, 0), (0, 1))
    ]
    return np.stack(parts, axis=1)


def _less(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b of polynomials of different degree."""
    out = np.zeros((len(a), max(a.shape[-1], b.shape[-1])))
    out[:, : a.shape[-1]] = a
    out[:, : b.shape[-1]] -= b
    return out


def _roots(polynomial: np.ndarray) -> np.ndarray:
    """Real parts of roots in (0, 1) that are real or nearly so, shape (n, degree); others 1."""
    degree = polynomial.shape[-1] - 1
    scale = np.abs(polynomial).max(axis=-1, keepdims=True)
    p = polynomial / np.where(scale > 0, scale, 1)
    lead = p[:, -1:]
    p[:, -1:] = np.where(np.abs(lead) > 1e-300, lead, 1e-300)
    companion = np.zeros((len(p), degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1
    with np.errstate(over="ignore"):
        companion[:, :, -1] = -p[:, :-1] / p[:, -1:]
    usable = np.asarray(np.isfinite(companion).all(axis=(1, 2)))
    companion[~usable] = 0
    roots = np.linalg.eigvals(companion)
    real = (np.abs(roots.imag) < 1e-3) & (roots.real > 0) & (roots.real < 1)
    return np.where(real & usable[:, None], roots.real, 1.0)


def distance(corners: np.ndarray) -> np.ndarray:
    """From the origin to triangles (..., 3 corners, 3): the least of corners, sides and face."""
    a, b, c = (corners[..., k, :] for k in range(3))
    best = np.full(a.shape[:-1], np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        d = q - p
        length2 = (d * d).sum(axis=-1)
        s = np.clip(-(p * d).sum(axis=-1) / np.where(length2 > 0, length2, 1), 0, 1)
        best = np.minimum(best, np.linalg.norm(p + s[..., None] * d, axis=-1))
    n = np.cross(b - a, c - a)
    area2 = (n * n).sum(axis=-1)
    signs = [(np.cross(q - p, -p) * n).sum(axis=-1) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    within = (area2 > 0) & signs[0] & signs[1] & signs[2]
    height = np.abs((a * n).sum(axis=-1)) / np.sqrt(np.where(area2 > 0, area2, 1))
    return np.where(within, np.minimum(best, height), best)


def nearest_approach(p0: np.ndarray, p1: np.ndarray, radius: float) -> np.ndarray:
    """Least distance of moving triangles to the origin wherever it is below `radius`, exactly.

    The distance to a triangle equals `radius` only where a distance to a corner, to the line of a
    side, or to its plane does. These are roots of polynomials in time of degree 2, 4 and 6. Between
    two such times it is on one side of it, so that a look in the middle of each interval tells.
    """
    moving = np.stack([p0, p1 - p0], axis=-1)  # (n, 3 corners, 3, coefficients)
    corner = [moving[:, k] for k in range(3)]
    times = []
    for c in corner:
        polynomial = _dot(c, c)
        polynomial[:, 0] -= radius**2
        times.append(_roots(polynomial))
    for i in range(3):
        p, q = corner[i], corner[(i + 1) % 3]
        moment = _cross(p, q)
        times.append(_roots(_less(_dot(moment, moment), radius**2 * _dot(q - p, q - p))))
    normal = _cross(corner[1] - corner[0], corner[2] - corner[0])
    volume = _dot(corner[0], normal)
    times.append(_roots(_less(_polynomial_product(volume, volume), radius**2 * _dot(normal, normal))))
    uniform = np.broadcast_to(np.linspace(0, 1, 17), (len(p0), 17))
    t = np.sort(np.concatenate([*times, uniform], axis=1), axis=1)
    t = np.concatenate([t, (t[:, 1:] + t[:, :-1]) / 2], axis=1)
    corners = p0[:, None] + t[..., None, None] * (p1 - p0)[:, None]
    return np.asarray(distance(corners).min(axis=1))


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
