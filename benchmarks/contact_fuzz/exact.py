"""Moving triangles against a sphere, exactly: roots of polynomials in time, no code of the core."""

from __future__ import annotations

import numpy as np
from contact.oracle import nearest_places


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
    """From the origin to triangles (..., 3 corners, 3)."""
    return nearest_places(corners.reshape(-1, 3, 3))[1].reshape(corners.shape[:-2])


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


def deepest_on_the_way(before: np.ndarray, after: np.ndarray, radius: float) -> float:
    """How deep triangles (n, 3, 3), in the sphere's frame, come on straight ways [m], >= 0.

    The sphere and every corner go straight from place to place. A triangle that the sphere crosses
    between two steps has to come nearer to its centre than the radius.
    """
    low = np.minimum(before, after).min(axis=1)
    high = np.maximum(before, after).max(axis=1)
    near = ((low < radius) & (high > -radius)).all(axis=1)
    if not near.any():
        return 0.0
    return max(0.0, float(radius - nearest_approach(before[near], after[near], radius).min()))
