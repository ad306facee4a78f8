"""The cloth in vectorised NumPy: slices and sums, without a compiler."""

from __future__ import annotations

from typing import Any

import clothsim as cs
import numpy as np
import numpy.typing as npt
from timing import Work

Slices = tuple[slice, slice, slice]

_CORNER = 8  # points along a side; a spring of any family is shorter


def spring_kinds(scene: cs.Scene) -> list[tuple[int, int, float, float, float]]:
    """(row offset, column offset, stiffness, rest length, damping) of each kind of spring.

    The spring table of a corner of the cloth has every kind; that of a large cloth needs 80 bytes a
    spring.
    """
    cloth = scene.cloth
    shape = (min(cloth.rows, _CORNER), min(cloth.columns, _CORNER))
    size = tuple(
        max(n - 1, 1) * (spacing or 1.0) for n, spacing in zip(shape, cloth.spacing, strict=True)
    )
    kinds: dict[tuple[int, int], tuple[int, int, float, float, float]] = {}
    for spring in cloth.replace(shape=shape, size=size, mass=1.0, pins=()).spring_table():
        (r, c), (far_r, far_c) = (divmod(int(spring[end]), shape[1]) for end in ("i", "j"))
        stiffness, rest, damping = (
            float(spring[name]) for name in ("stiffness", "rest_length", "damping")
        )
        kinds.setdefault((far_r - r, far_c - c), (far_r - r, far_c - c, stiffness, rest, damping))
    return list(kinds.values())


def spring_ends(r: int, c: int) -> tuple[Slices, Slices]:
    """Slices of a (3, rows, columns) array that give the near and the far ends of a kind."""
    rows = slice(None, -r or None), slice(r, None)
    columns = slice(None, -c or None), slice(c, None)
    if c < 0:
        columns = slice(-c, None), slice(None, c)
    return (slice(None), rows[0], columns[0]), (slice(None), rows[1], columns[1])


class NumpyPeer(Work):
    """A scene without spheres, of uniform mass; RK4 on (x, v), each (3, rows, columns)."""

    def __init__(
        self, scene: cs.Scene, x: np.ndarray, v: np.ndarray, dt: float, dtype: type[Any]
    ) -> None:
        self.x: npt.NDArray[Any] = np.ascontiguousarray(np.moveaxis(x, -1, 0), dtype)
        self.v: npt.NDArray[Any] = np.ascontiguousarray(np.moveaxis(v, -1, 0), dtype)
        self.dt = dtype(dt)
        self.half = dtype(dt / 2)
        self.sixth = dtype(dt / 6)
        self.gravity: npt.NDArray[Any] = np.array(scene.gravity, dtype).reshape(3, 1, 1)
        self.inverse_mass = dtype(1 / scene.cloth.mass_per_point[0, 0])
        self.free: npt.NDArray[Any] = (~scene.cloth.pinned).astype(dtype)
        self.kinds = [
            (*spring_ends(r, c), dtype(k), dtype(rest), dtype(damping))
            for r, c, k, rest, damping in spring_kinds(scene)
        ]

    def _acceleration(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        force = np.zeros_like(x)
        for near, far, stiffness, rest, damping in self.kinds:
            d = x[far] - x[near]
            w = v[far] - v[near]
            length = np.sqrt((d * d).sum(axis=0))
            scale = stiffness * (1 - rest / length) + damping * (w * d).sum(axis=0) / (
                length * length
            )
            d *= scale
            force[near] += d
            force[far] -= d
        force *= self.inverse_mass
        force += self.gravity
        force *= self.free
        return force

    def run(self, steps: int) -> None:
        h, half = self.dt, self.half
        x, v = self.x, self.v
        for _ in range(steps):
            a1 = self._acceleration(x, v)
            v2 = v + half * a1
            a2 = self._acceleration(x + half * v, v2)
            v3 = v + half * a2
            a3 = self._acceleration(x + half * v2, v3)
            v4 = v + h * a3
            a4 = self._acceleration(x + h * v3, v4)
            x += self.sixth * (v + 2 * (v2 + v3) + v4)
            v += self.sixth * (a1 + 2 * (a2 + a3) + a4)

    @property
    def positions(self) -> np.ndarray:
        return np.moveaxis(self.x, 0, -1)
