"""An independent judge of triangles and spheres, in NumPy: it shares no code with the core."""

from __future__ import annotations

import numpy as np


def corner_indices(shape: tuple[int, int]) -> np.ndarray:
    """Indices (triangles, 3) of the corners of a cloth's triangles."""
    i = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = (part.ravel() for part in (i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def nearest_places(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n, 3) of the places of triangles (n, 3, 3) nearest to the origin, and distances."""
    count = len(corners)
    least, weights = np.full(count, np.inf), np.zeros((count, 3))

    def consider(candidate: np.ndarray, valid: np.ndarray) -> None:
        distance = np.linalg.norm((candidate[..., None] * corners).sum(axis=1), axis=1)
        better = valid & (distance < least)
        least[better] = distance[better]
        weights[better] = candidate[better]

    always = np.ones(count, dtype=bool)
    for k in range(3):
        consider(np.tile(np.eye(3)[k], (count, 1)), always)
        j = (k + 1) % 3
        side = corners[:, j] - corners[:, k]
        length2 = (side * side).sum(axis=1)
        part = np.clip(-(side * corners[:, k]).sum(axis=1) / np.where(length2 > 0, length2, 1), 0, 1)
        candidate = np.zeros((count, 3))
        candidate[:, k], candidate[:, j] = 1 - part, part
        consider(candidate, always)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    area2 = (normal * normal).sum(axis=1)
    divisor = np.where(area2 > 0, area2, 1)
    u = -(np.cross(corners[:, 0], second) * normal).sum(axis=1) / divisor
    v = -(np.cross(first, corners[:, 0]) * normal).sum(axis=1) / divisor
    inner = np.stack([1 - u - v, u, v], axis=1)
    consider(inner, (area2 > 0) & (inner >= 0).all(axis=1))
    return weights, least
