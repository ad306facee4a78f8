"""The state in the shader's layout: six planes per member; in single each is split into two float32 planes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import _core
from ..model.scene import Scene


def planes_of(x: np.ndarray, v: np.ndarray, scenes: Sequence[Scene]) -> np.ndarray:
    """Positions [m] and velocities [m/s], shape ([B,] rows, columns, 3), as float64 planes (members, 6, points).

    Pinned points rest. There is one scene for each member.
    """
    shape = (len(scenes), -1, 3)
    planes = np.concatenate([x.reshape(shape), v.reshape(shape)], axis=2).transpose(0, 2, 1)
    planes = planes.astype(np.float64, order="C")
    stop_pinned_points(planes, scenes)
    return planes


def stop_pinned_points(planes: np.ndarray, scenes: Sequence[Scene]) -> None:
    """Set the velocities of pinned points to 0."""
    for member, scene in enumerate(scenes):
        planes[member, 3:, scene.cloth.pinned.ravel()] = 0


def far_origins(positions: np.ndarray) -> np.ndarray:
    """Origins, shape (members, 3), of positions in single, shape (members, 3, points) [m].

    An origin is 0, except for a cloth that is far away for its size.
    """
    low, high = positions.min(axis=2), positions.max(axis=2)
    middle = low / 2 + high / 2
    distance = np.linalg.norm(middle, axis=1)
    far = distance > _core.extents_that_are_far * np.linalg.norm(high - low, axis=1)
    far &= distance < np.finfo(np.float32).max
    return np.where(far[:, None], middle, 0.0)


def split(planes: np.ndarray, single: bool) -> list[np.ndarray]:
    """Split float64 planes into the parts to upload: the state, and in single also its compensation."""
    if not single:
        return [planes]
    whole = planes.astype(np.float32)
    return [whole, (planes - whole).astype(np.float32)]


def joined(parts: Sequence[np.ndarray], origins: np.ndarray) -> np.ndarray:
    """The parts as float64 planes in the scene's coordinates, shape (members, 6, points)."""
    whole = parts[0].astype(np.float64)
    for part in parts[1:]:
        whole += part
    origins = origins[:, :, None]
    positions = whole[:, :3]
    np.add(positions, origins, out=positions, where=origins != 0)  # -0 stays -0
    return whole


def arrays_of(planes: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Planes (..., 6, points) as positions and velocities of `shape`."""
    return vectors_of(planes, 0, shape), vectors_of(planes, 3, shape)


def vectors_of(planes: np.ndarray, first: int, shape: tuple[int, ...]) -> np.ndarray:
    """Three planes of (..., 6, points), from `first` on, as vectors of `shape`."""
    return planes[..., first : first + 3, :].swapaxes(-1, -2).reshape(shape)
