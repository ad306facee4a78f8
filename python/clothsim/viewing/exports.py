"""`Run.export`: a run as files for other programs."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from .. import _core
from ..base import Floats, check, files
from ..base.extras import import_from_extra
from ..base.progress import ProgressBar
from ..engine.options import Options, cached_plan
from ..model.mesh import triangles
from .camera import extremes_along_axes
from .picture import check_file_path

# Suffix -> module of `formats`.
FORMATS = {".usdc": "usd", ".usda": "usd", ".glb": "gltf"} | dict.fromkeys(
    (".obj", ".ply", ".pvd", ".pc2"), "meshes"
)
MOST_FPS = 1e5  # frames/s
# Part of the time between two stored frames; a frame closer to a stored one is that one.
SAME_TIME = 1e-9
EVEN = 1e-6  # part of the longest step by which steps of even frames may differ
FARTHEST = 1e38  # m from the origin; files have float32
# Interpolation errors, in grid spacings. A tenth shows as a dent where the cloth lies on a sphere;
# a whole spacing moves a mass point to where its neighbour belongs.
VISIBLE = 0.1
USELESS = 1.0


def check_export_path(scene: Any, path: Any, name: str = "path") -> tuple[Path, ModuleType]:
    """Return the file of an export of a run of `scene`, and the module that writes it; `name` names
    `path` in messages.
    """
    path = check_file_path(name, path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{name} must end in one of {', '.join(FORMATS)}, got {str(path)!r}")
    if min(scene.cloth.shape) < 2:
        raise ValueError(
            f"{name} {str(path)!r} needs a surface, a cloth of at least 2 x 2 mass points, "
            f"got shape {scene.cloth.shape}"
        )
    if FORMATS[suffix] == "usd":
        import_from_extra("pxr", f"export to {suffix}", "export")
    return path, import_module(f"{__package__}.formats.{FORMATS[suffix]}")


def export(
    run: Any,
    path: str | os.PathLike[str],
    fps: float | None = None,
    z_up: bool = False,
    progress: bool = False,
) -> list[Path]:
    """Export a run, as `Run.export` does; its files come to their places once all are complete.
    With `progress`, a bar counts frames.
    """
    path, module = check_export_path(run.scene, path)
    fps = (
        None
        if fps is None
        else check.number("fps", fps, minimum=0, exclusive=True, maximum=MOST_FPS)
    )
    if check.boolean("z_up", z_up) and path.suffix.lower() == ".glb":
        raise ValueError(
            "z_up must be False for .glb, where y is always up: importers turn it, Blender's too"
        )
    clip = Clip(run, fps, z_up)
    with (
        ProgressBar(progress, total=len(clip), unit="frame", desc="export") as bar,
        files.temporary_folder_beside(path) as folder,
    ):
        clip.advance = bar.advance
        return files.move_files(module.write(clip, folder / path.name), path.parent)


class Frame(NamedTuple):
    """One frame: positions [m] and velocities [m/s] of shape (points, 3), sphere centres [m]."""

    number: int
    time: float  # [s]
    positions: Floats
    velocities: Floats
    centers: Floats  # (spheres, 3)


class Clip:
    """A run as frames of a surface, in the axes of the file; `z_up` writes (x, y, z) as (x, -z, y).

    `fps` is the number of frames per second, or None for the stored frames at their own times; the
    attribute then has their rate, or None if they are not evenly spaced. `rate` is the same, but
    regards no last frame that follows sooner, as at the end of a run. `advance` is called after
    each frame. `times` [s] begin at 0, the time `start` of the run. `uv`, shape (points, 2), are
    texture coordinates: from above, with x to the right, a picture is upright and not mirrored.
    """

    def __init__(self, run: Any, fps: float | None, z_up: bool) -> None:
        self.scene = run.scene
        self.z_up = z_up
        self._run = run
        self.spheres = tuple(run.scene.spheres)
        self.triangles = triangles(run.scene.cloth.shape)
        rows, columns = run.scene.cloth.shape
        self.uv = np.stack(
            np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows)), -1
        ).reshape(-1, 2)
        self.advance: Callable[[], Any] = lambda: None
        farthest = max(float(run.x.max()), -float(run.x.min()))
        if farthest > FARTHEST:
            raise ValueError(
                f"x must be places at most {FARTHEST:g} m from the origin to be exported, got one "
                f"{farthest:.3g} m away"
            )
        duration = run.t[-1] - run.t[0]
        self.start = float(run.t[0])
        if fps is None:
            self.times = np.asarray(run.t - run.t[0])
            steps = np.diff(self.times)
            self.fps = _frames_per_second(steps)
            self.rate = self.fps
            if self.fps is None and len(steps) > 2 and steps[-1] < steps[0]:
                self.rate = _frames_per_second(steps[:-1])
        else:
            self.fps = self.rate = fps
            self.times = np.arange(int(duration * fps * (1 + SAME_TIME)) + 1) / fps
            if len(self.times) < 2 <= len(run.t):
                raise ValueError(
                    f"fps must be at least {1 / duration:.6g} for a run of {duration:g} s, got "
                    f"{fps:g}; fps=None writes the stored frames"
                )
        if len(run.t) == 1:
            self._gaps = self._stored = np.zeros(1, int)
            return
        self._gaps = np.clip(
            np.searchsorted(run.t, self.times + run.t[0], "right") - 1, 0, len(run.t) - 2
        )
        parts = (self.times + run.t[0] - run.t[self._gaps]) / (
            run.t[self._gaps + 1] - run.t[self._gaps]
        )
        self._stored = np.where(
            np.abs(parts - parts.round()) < SAME_TIME, self._gaps + parts.round().astype(int), -1
        )
        if fps is not None and (self._stored < 0).any():
            _check_interpolation(run, fps)

    def __len__(self) -> int:
        return len(self.times)

    def make_frames(self) -> Iterator[Frame]:
        for k in range(len(self)):
            yield self[k]
            self.advance()

    def __getitem__(self, k: int) -> Frame:
        stored = self._stored[k]
        gap = self._gaps[k]
        if stored >= 0:
            x = self._run.x[stored]
            v = self._run.v[stored]
        else:
            x, v = interpolate_state(self._run, gap, gap + 1, float(self.times[k] + self._run.t[0]))
        x = self._in_axes_of_file(x.reshape(-1, 3))
        v = self._in_axes_of_file(v.reshape(-1, 3))
        return Frame(k, float(self.times[k]), x, v, self.sphere_centers(k))

    def sphere_centers(self, k: int) -> Floats:
        """Return the centres of the spheres in frame `k`, shape (spheres, 3) [m]."""
        t = self.times[k] + self._run.t[0]
        return self._in_axes_of_file(
            np.array([s.center_at(t) for s in self.spheres]).reshape(-1, 3)
        )

    def obstacle_name(self, k: int) -> str:
        """Return the name of sphere or plane `k` in files."""
        return f"{type(self.spheres[k]).__name__.lower()}_{k}"

    @cached_property
    def bounding_box(self) -> tuple[Floats, Floats]:
        """Lowest and highest place of the cloth and of spheres near it in the whole run."""
        ends = extremes_along_axes(self.scene, self._run.x, self._run.t, np.eye(3))
        low, high = np.sort([self._in_axes_of_file(end) for end in ends], axis=0)
        return low, high

    def plane_normal(self, k: int) -> Floats:
        """Return the unit normal of a plane."""
        return self._in_axes_of_file(self.spheres[k].unit_normal)

    def depth_below_obstacle(self, k: int, places: Floats) -> Floats:
        """Return the depth below sphere or plane `k` of places from its centre [m]."""
        radius = self.spheres[k].radius
        return (
            -(places @ self.plane_normal(k))
            if np.isinf(radius)
            else radius - np.linalg.norm(places, axis=-1)
        )

    def _in_axes_of_file(self, vectors: Floats) -> Floats:
        return (
            np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], -1)
            if self.z_up
            else vectors
        )

    def point_normals(self, positions: Floats) -> Floats:
        """Return the unit normals of the mass points: the area-weighted mean of their triangles'
        normals, or y where it is 0.
        """
        a, b, c = (positions[self.triangles[:, k]] for k in range(3))
        weights = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        corners = self.triangles.ravel()
        normals = np.stack(
            [np.bincount(corners, weights[:, k], len(positions)) for k in range(3)], -1
        )
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        return np.where(length > 0, normals / np.where(length > 0, length, 1.0), [0.0, 1.0, 0.0])


def _frames_per_second(steps: Floats) -> float | None:
    """Return the frames per second of equal steps [s], else None."""
    if not len(steps) or np.ptp(steps) > EVEN * steps.max():
        return None
    return float(f"{len(steps) / steps.sum():.12g}")


def interpolate_state(run: Any, first: int, second: int, t: float) -> tuple[Floats, Floats]:
    """Return the positions and velocities at a time `t` [s] between two stored frames."""
    begin = float(run.t[first])
    length = float(run.t[second]) - begin
    ends = (run.x[first], run.v[first], run.x[second], run.v[second])
    return _core.interpolate(cached_plan(run.scene, Options()), t, begin, length, *ends)


def _check_interpolation(run: Any, fps: float) -> None:
    """Give a warning or an error if stored frames are too far apart for the requested frames.

    Each inner stored frame is interpolated from its two neighbours, which are about twice as far
    apart as stored frames. The error between stored frames is therefore a sixteenth of that where
    the motion is smooth, and half of it at a bounce.
    """
    cure = (
        f"simulate with every={1 / fps:.6g} to store the frames exported, or export with fps=None"
    )
    if len(run.t) < 3:
        raise ValueError(
            f"run must store frames between its first and last state to be exported at {fps:g} "
            f"frames a second, got {len(run.t)} frames; {cure}"
        )
    ways = (
        interpolate_state(run, k - 1, k + 1, float(run.t[k]))[0] - run.x[k]
        for k in range(1, len(run.t) - 1)
    )
    error = max(float(np.linalg.norm(way, axis=-1).max()) for way in ways)
    spacing = min(run.scene.cloth.spacing)
    reason = (
        f"a stored frame interpolated from its neighbours is wrong by {error:.3g} m, with a "
        f"grid spacing of {spacing:.3g} m"
    )
    if error > USELESS * spacing:
        raise ValueError(f"stored frames of run are too far apart to interpolate: {reason}; {cure}")
    if error > VISIBLE * spacing:
        warnings.warn(f"interpolated frames may be visibly wrong: {reason}; {cure}", stacklevel=5)
