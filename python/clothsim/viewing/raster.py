"""Colours of pictures, and how cloth and spheres lie in them. The core draws (cpp/picture)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import Floats
from .camera import Camera

# Colours that stay apart under each of the three colour vision deficiencies (tests/view measure
# it).
BACKGROUND = np.array([1.0, 1.0, 1.0])
CLOTH_FRONT = np.array([0.27, 0.47, 0.72])
CLOTH_BACK = np.array([0.87, 0.73, 0.45])
SPHERE = np.array([0.80, 0.81, 0.83])
# A sphere beside a cloth coloured by depth, which is pale outside.
DARK_SPHERE = np.array([0.42, 0.44, 0.48])
PIN = np.array([0.15, 0.15, 0.15])
PENETRATION = np.array([0.86, 0.08, 0.10])
FULL_RED_DEPTH = 0.010  # m; cloth this deep under the sphere's surface is painted fully red
LEAST_RED = 0.35  # part of red at no depth, so that any penetration is seen
KEY = np.array([0.3, 1.0, 0.25])  # direction to the light
LIGHT = (0.46, 0.10, 0.32, 0.28)  # ambient, from above, from `KEY`, from the eye
GRID_LINE = 0.05  # half width of a drawn grid line, in cells
GRID_SHADE = 0.72  # factor of the colour on a grid line
GROUND = np.array([0.93, 0.93, 0.92])
PLANE_CELL = 0.1  # m between the lines of a plane's grid
PLANE_LINE = 0.0015  # m, half the width of such a line
PLANE_SHADE = 0.8  # factor of the colour on such a line
PLANE_TONE = _core.PLANE_TONE  # part of the light on a cloth that planes take
PLANE_IN_SHADOW = _core.PLANE_IN_SHADOW  # factor of a plane's colour in full shadow
LIGHT_SIZE = _core.LIGHT_SIZE  # tangent of the angle at which a point sees the light's radius
SAMPLES = _core.SAMPLES  # of a pixel, along each axis


class Ball(NamedTuple):
    """A sphere to draw; the cloth inside it is shown where `solid`."""

    center: npt.ArrayLike
    radius: float
    color: Floats
    solid: bool = True


class Plane(NamedTuple):
    """A plane through `point`, seen from the side of its `normal`; it fades out up to `radius` [m]
    from the point. With `node`, a place on it [m], it has a grid, two of whose lines cross there.
    """

    point: npt.ArrayLike
    radius: float
    normal: npt.ArrayLike = (0.0, 1.0, 0.0)
    color: Floats = GROUND
    solid: bool = False
    node: npt.ArrayLike | None = None


def grid_directions(normal: npt.ArrayLike) -> Floats:
    """Return unit vectors along the lines of a plane's grid, as rows: level, and up the slope."""
    n = np.asarray(normal, float)
    level = np.cross((0.0, 1.0, 0.0), n)
    if np.linalg.norm(level) < 1e-6:
        level = np.array([1.0, 0.0, 0.0])
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(n, level)])


def render(
    positions: npt.ArrayLike,
    balls: Sequence[Ball],
    camera: Camera,
    width: int = 520,
    *,
    colors: Floats | None = None,
    depth: Any = None,
    planes: Sequence[Plane] = (),
    shadow: bool = False,
    threads: int = 1,
) -> npt.NDArray[np.uint8]:
    """Draw the cloth with mass points at `positions` [m], shape (rows, columns, 3), balls and
    planes.

    The picture has shape (height, width, 3); its height follows from the camera. `colors` of the
    mass points, shape (rows, columns, 3), are 0 to 1; without them each face has its own. `depth`,
    a `legend.Scale`, colours each place of the cloth by its depth in a solid. With `shadow`, the
    light from the side casts shadows.
    """
    height = max(1, round(width * camera.height / camera.width))
    axes = camera.axes()
    scale = SAMPLES * width / camera.width
    points = np.ascontiguousarray(positions, float)
    view = _core.View(
        width=width,
        height=height,
        axes=axes,
        target=camera.target,
        scale=scale,
        distance=camera.distance or 0.0,
    )
    shading = _core.Shading(
        colors={
            "background": BACKGROUND,
            "front": CLOTH_FRONT,
            "back": CLOTH_BACK,
            "penetration": PENETRATION,
        },
        full_red_depth=FULL_RED_DEPTH,
        least_red=LEAST_RED,
        key=KEY / np.linalg.norm(KEY),
        light=LIGHT,
        grid_line=GRID_LINE,
        grid_shade=GRID_SHADE,
        plane_grid=(PLANE_CELL, PLANE_LINE, PLANE_SHADE),
        shadow=shadow,
        depth_colors=[] if depth is None else depth.stop_colors(),
        depth_range=(0.0, 1.0) if depth is None else (depth.low, depth.high),
    )
    return _core.render(
        view=view,
        shading=shading,
        points=points,
        screen=_project_on_screen(points, camera, axes, scale, SAMPLES * width, SAMPLES * height),
        normals=_point_normals(points),
        colors=None if colors is None else np.ascontiguousarray(colors, float),
        balls=[[*np.asarray(b.center), b.radius, *b.color, b.solid] for b in balls],
        planes=[_plane_values_for_core(plane) for plane in planes],
        threads=threads,
    )


def _plane_values_for_core(plane: Plane) -> list[float]:
    """Return a plane as the core reads it (cpp/bindings/bind_picture.cpp)."""
    grid = np.zeros((3, 3))
    if plane.node is not None:
        grid = np.vstack([grid_directions(plane.normal), plane.node])
    values = (plane.point, plane.normal, plane.radius, plane.color, plane.solid, grid)
    return [float(value) for part in values for value in np.ravel(part)]


def _project_on_screen(
    points: Floats, camera: Camera, axes: Floats, scale: float, width: int, height: int
) -> Floats:
    """Return samples to the right and down, and nearness; see Sheet in cpp/picture/picture.hpp."""
    places = np.einsum("rck,ak->rca", points - camera.target, axes)
    nearness = places[..., 2]
    if camera.distance is not None:
        distance = camera.distance - nearness
        nearness = 1 / np.where(distance > 0, distance, np.nan)
        places *= (camera.distance * nearness)[..., None]
    return np.stack(
        [width / 2 + scale * places[..., 0], height / 2 - scale * places[..., 1], nearness], -1
    )


def _point_normals(points: Floats) -> Floats:
    if min(points.shape[:2]) < 2:
        return np.zeros_like(points)
    along_rows, along_columns = np.gradient(points, axis=(0, 1))
    normals: Floats = np.cross(along_rows, along_columns)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    return normals
