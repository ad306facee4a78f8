"""A run as frames of a surface, the input of every export format."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats
from ..model.mesh import triangles

# Relative to the time between two stored frames; a frame closer to a stored one is that one.
_SAME_TIME = 1e-9
# Interpolation errors relative to the grid spacing. A tenth shows as a dent where the cloth lies
# on a sphere; a whole spacing moves a mass point to where its neighbour belongs.
_VISIBLE, _USELESS = 0.1, 1.0


@dataclass(frozen=True)
class Frame:
    """One frame: positions [m] and velocities [m/s] of shape (points, 3), sphere centres [m]."""

    number: int
    time: float  # [s]
    positions: Floats
    velocities: Floats
    centers: Floats  # (spheres, 3)


class Clip:
    """Frames of a run in the axes of the file; `z_up` writes (x, y, z) as (x, -z, y).

    With `fps` there are so many frames a second, with None the stored frames at their own times; afterwards `fps` is None
    where their distances differ. `advance` is called after each frame. `times` [s] begin at 0.
    """

    def __init__(self, run: Any, fps: float | None, z_up: bool) -> None:
        self.scene, self.z_up = run.scene, z_up
        self.spheres, self.up = tuple(run.scene.spheres), "Z" if z_up else "Y"
        self.times = _times(run, fps)
        steps = np.diff(self.times)
        even = fps is None and np.ptp(steps) <= 1e-6 * steps.max()
        self.fps = float(f"{len(steps) / self.times[-1]:.12g}") if even else fps
        self.advance: Callable[[], Any] = lambda: None
        self._run = run
        gaps, inside = _gaps(run.t, self.times + run.t[0])
        self._gaps, self._inside = gaps, inside
        if fps is not None and ((inside > 0) & (inside < 1)).any():
            _check_interpolation(run, fps)

    @cached_property
    def triangles(self) -> npt.NDArray[np.int64]:
        """Corners in the order of `clothsim.triangles`."""
        return triangles(self.scene.cloth.shape)

    @cached_property
    def uv(self) -> Floats:
        """Texture coordinates, shape (points, 2). From above, with x to the right, a picture is upright and not mirrored."""
        rows, columns = self.scene.cloth.shape
        u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows))
        return np.stack([u.ravel(), v.ravel()], -1)

    def __len__(self) -> int:
        return len(self.times)

    def frames(self) -> Iterator[Frame]:
        for k in range(len(self)):
            yield self[k]
            self.advance()

    def __getitem__(self, k: int) -> Frame:
        if not 0 <= k < len(self):
            raise IndexError(k)
        x, v = hermite(self._run, self._gaps[k], self._inside[k])
        x, v = self._turned(x.reshape(-1, 3)), self._turned(v.reshape(-1, 3))
        return Frame(k, float(self.times[k]), x, v, self.centers(k))

    def centers(self, k: int) -> Floats:
        """Centres of the spheres in frame `k`, shape (spheres, 3) [m]."""
        t = self.times[k] + self._run.t[0]
        return self._turned(np.array([s.center_at(t) for s in self.spheres]).reshape(-1, 3))

    def _turned(self, vectors: Floats) -> Floats:
        if not self.z_up:
            return vectors
        return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], -1)

    def normals(self, positions: Floats) -> Floats:
        """Unit normals of the mass points, the mean over their triangles weighted by area."""
        return vertex_normals(positions, self.triangles)


def vertex_normals(positions: Floats, corners: npt.NDArray[np.int64]) -> Floats:
    """Unit normals of the vertices: the mean over the triangles of each vertex, weighted by area. No normal is (0, 0,
    0).

    A vertex whose triangles have no area gets the unit vector along y.
    """
    a, b, c = (positions[corners[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    weights = np.repeat(faces, 3, axis=0)
    normals = np.stack([np.bincount(corners.ravel(), weights[:, k], len(positions)) for k in range(3)], -1)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    flat = length == 0
    return np.where(flat, [0.0, 1.0, 0.0], normals / np.where(flat, 1.0, length))


def hermite(run: Any, gap: int, inside: float, following: int | None = None) -> tuple[Floats, Floats]:
    """State between the stored frames `gap` and `following` by cubic Hermite interpolation.

    ::

        x(s) = (2 s^3 - 3 s^2 + 1) x0 + (3 s^2 - 2 s^3) x1 + h ((s^3 - 2 s^2 + s) v0 + (s^3 - s^2) v1)

    `inside` is s, from 0 to 1; h is the time between the frames. The velocity is the derivative.
    """
    if inside == 0:
        return run.x[gap], run.v[gap]
    following = gap + 1 if following is None else following
    if inside == 1:
        return run.x[following], run.v[following]
    s, h = inside, run.t[following] - run.t[gap]
    x0, x1, v0, v1 = run.x[gap], run.x[following], run.v[gap], run.v[following]
    x = (2 * s**3 - 3 * s**2 + 1) * x0 + (3 * s**2 - 2 * s**3) * x1
    x = x + h * ((s**3 - 2 * s**2 + s) * v0 + (s**3 - s**2) * v1)
    v = (6 * s**2 - 6 * s) / h * (x0 - x1) + (3 * s**2 - 4 * s + 1) * v0 + (3 * s**2 - 2 * s) * v1
    return x, v


def _times(run: Any, fps: float | None) -> Floats:
    if fps is None:
        return np.asarray(run.t - run.t[0])
    duration = run.t[-1] - run.t[0]
    count = int(np.floor(duration * fps * (1 + _SAME_TIME))) + 1
    if count < 2:
        raise ValueError(
            f"fps must be at least {1 / duration:.6g} for a run of {duration:g} s, got {fps:g}; "
            "fps=None writes the stored frames"
        )
    return np.arange(count) / fps


def _gaps(stored: Floats, times: Floats) -> tuple[npt.NDArray[np.int64], Floats]:
    """For each time, the stored frame before it, and the fraction of the way to the next frame (0 to 1)."""
    gaps = np.clip(np.searchsorted(stored, times, "right") - 1, 0, len(stored) - 2)
    inside = (times - stored[gaps]) / (stored[gaps + 1] - stored[gaps])
    inside = np.where(np.abs(inside) < _SAME_TIME, 0.0, inside)
    return gaps, np.where(inside > 1 - _SAME_TIME, 1.0, inside)


def interpolation_error(run: Any) -> float:
    """Largest error of interpolating each inner stored frame from its two neighbours [m].

    The gap between the neighbours is about twice that between stored frames. Where the motion is
    smooth, errors between stored frames are a sixteenth of it; at a bounce, half of it.
    """
    worst = 0.0
    for k in range(1, len(run.t) - 1):
        inside = (run.t[k] - run.t[k - 1]) / (run.t[k + 1] - run.t[k - 1])
        x, _ = hermite(run, k - 1, inside, k + 1)
        worst = max(worst, float(np.linalg.norm(x - run.x[k], axis=-1).max()))
    return worst


def _check_interpolation(run: Any, fps: float) -> None:
    """Give a warning or an error if stored frames are too far apart for the requested frames."""
    cure = f"simulate with every={1 / fps:.6g} to store the frames exported, or export with fps=None"
    if len(run.t) < 3:
        raise ValueError(
            f"run must store frames between its first and last state to be exported at {fps:g} "
            f"frames a second, got {len(run.t)} frames; {cure}"
        )
    error, spacing = interpolation_error(run), min(run.scene.cloth.spacing)
    found = (
        f"a stored frame interpolated from its neighbours is wrong by {error:.3g} m, with a grid spacing of {spacing:.3g} m"
    )
    if error > _USELESS * spacing:
        raise ValueError(f"stored frames of run are too far apart to interpolate: {found}; {cure}")
    if error > _VISIBLE * spacing:
        warnings.warn(f"interpolated frames may be visibly wrong: {found}; {cure}", stacklevel=5)
