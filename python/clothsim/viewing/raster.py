"""A depth-buffered picture of a cloth and its spheres, in NumPy alone.

Sorting of whole triangles cannot show contact, because cloth and sphere lie tenths of a millimetre apart. The triangles
are a hundred times larger. Here each pixel keeps the nearest cloth point, and spheres are intersected exactly. A patch
where the sphere's surface lies above the cloth is painted red by its depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera

Floats = npt.NDArray[np.floating]
Integers = npt.NDArray[np.integer]

# Colours that stay apart under each of the three colour vision deficiencies (tests/view measure it).
BACKGROUND = np.array([1.0, 1.0, 1.0])
CLOTH_FRONT = np.array([0.27, 0.47, 0.72])
CLOTH_BACK = np.array([0.87, 0.73, 0.45])
SPHERE = np.array([0.80, 0.81, 0.83])
PIN = np.array([0.15, 0.15, 0.15])
PENETRATION = np.array([0.86, 0.08, 0.10])
FULL_RED_DEPTH = 0.010  # m; cloth this deep under the sphere's surface is painted fully red
LEAST_RED = 0.35  # part of red at no depth, so that any penetration is seen
KEY = np.array([0.3, 1.0, 0.25])  # direction to the light
LIGHT = (0.46, 0.10, 0.32, 0.28)  # ambient, from above, from `KEY`, from the eye
GRID_LINE = 0.05  # half width of a drawn grid line, in cells
CHUNK = 1 << 19  # pairs of triangle and pixel that are held at a time: some 60 MB


@dataclass(frozen=True)
class Ball:
    """A sphere to draw; the cloth inside it is painted red where `solid`."""

    center: npt.ArrayLike
    radius: float
    color: Floats
    solid: bool = True


def render(
    positions: npt.ArrayLike, triangles: Integers, balls: Sequence[Ball], camera: Camera, width: int = 520, samples: int = 2
) -> npt.NDArray[np.uint8]:
    """Draw the cloth and the balls.

    Parameters
    ----------
    positions : array, shape (rows, columns, 3)
        Mass points [m].
    triangles : int array, shape (n, 3)
        Point indices of the cloth's triangles.
    balls : sequence of Ball
    camera : Camera
    width : int
        Pixels along the picture; its height follows from the camera.
    samples : int
        Samples a pixel along each axis.

    Returns
    -------
    uint8 array, shape (height, width, 3)
    """
    size = width, max(1, round(width * camera.height / camera.width))
    width, height = size[0] * samples, size[1] * samples
    axes, scale = camera.axes(), width / camera.width
    positions = np.asarray(positions, float)

    def to_screen(points: npt.ArrayLike) -> Floats:
        seen = (np.asarray(points, float) - camera.target) @ axes.T
        return np.stack([width / 2 + scale * seen[..., 0], height / 2 - scale * seen[..., 1], seen[..., 2]], -1)

    screen = to_screen(positions.reshape(-1, 3))
    depth, nearest, weights = _nearest_triangles(screen, triangles, width, height)
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = BACKGROUND
    hit = nearest >= 0
    corners, weights = triangles[nearest[hit]], weights[hit]
    if hit.any():
        picture[hit] = _cloth_color(positions, corners, weights, axes[2])
    if balls:
        surface = np.full((height, width, 3), np.nan, np.float32)
        surface[hit] = _blend(weights, positions.reshape(-1, 3), corners)
    for ball in balls:
        _draw_ball(picture, depth, surface, ball, to_screen(ball.center), scale, axes)

    parts = [picture[i::samples, j::samples] for i in range(samples) for j in range(samples)]
    return np.round(255 / len(parts) * sum(parts)).clip(0, 255).astype(np.uint8)


def _blend(weights: Floats, values: npt.NDArray[Any], corners: Integers) -> Floats:
    """Interpolate values at the corners of triangles, shape (n, 3, k), by barycentric weights."""
    a, b, c = (weights[:, k, None] * values[corners[:, k]] for k in range(3))
    result: Floats = a + b + c
    return result


def _draw_ball(
    picture: Floats, depth: Floats, surface: Floats, ball: Ball, middle: Floats, scale: float, axes: Floats
) -> None:
    """Draw a ball where it is nearest; `surface` has the cloth's point behind each pixel, or NaN."""
    height, width = depth.shape
    x, y, z = middle
    reach = scale * ball.radius
    rows = slice(max(0, int(y - reach)), max(0, min(height, int(y + reach) + 1)))
    columns = slice(max(0, int(x - reach)), max(0, min(width, int(x + reach) + 1)))
    box = rows, columns
    u = (np.arange(width)[columns] + 0.5 - x) / reach
    v = (y - np.arange(height)[rows, None] - 0.5) / reach
    inside = 1.0 - u * u - v * v
    half = np.sqrt(np.maximum(inside, 0.0))
    front = z + ball.radius * half
    drawn = (inside > 0) & (front > depth[box])
    u, v = np.broadcast_arrays(u, v)
    normals = np.stack([u[drawn], v[drawn], half[drawn]], -1) @ axes
    color = _shade(ball.color, normals, axes[2])
    if ball.solid:
        under = ball.radius - np.linalg.norm(surface[box][drawn] - ball.center, axis=-1)
        # Cloth on the far half of the ball is not what the eye sees here.
        far = np.isnan(under) | (depth[box][drawn] < z)
        color = _redden(color, np.where(far, 0.0, under))
    picture[box][drawn] = color
    depth[box][drawn] = front[drawn]


def _nearest_triangles(screen: Floats, triangles: Integers, width: int, height: int) -> tuple[Floats, Integers, Floats]:
    """Per pixel: depth (towards the eye), triangle number or -1, barycentric weights."""
    depth = np.full(height * width, -np.inf)
    nearest = np.full(height * width, -1)
    weights = np.empty((height * width, 3))
    limit = np.array([width, height])
    corners = screen[triangles]
    low = np.floor(corners[..., :2].min(axis=1)).clip(0, limit).astype(int)
    high = np.ceil(corners[..., :2].max(axis=1)).clip(0, limit).astype(int)
    across, down = (high - low).T
    # Weights of corners b and c are linear in the distance of a pixel's middle from corner a.
    a = corners[:, 0]
    (bx, by, bz), (cx, cy, cz) = (corners[:, 1] - a).T, (corners[:, 2] - a).T
    twice_area = bx * cy - by * cx
    x0, y0 = (low + 0.5 - a[:, :2]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        b_x, b_y, c_x, c_y = (k / twice_area for k in (cy, -cx, -by, bx))
    seen = np.flatnonzero((twice_area != 0) & (across > 0) & (down > 0))
    parts = np.cumsum((across * down)[seen]) // CHUNK
    for part in np.split(seen, np.flatnonzero(np.diff(parts)) + 1):
        pixels = (across * down)[part]
        n = np.repeat(part, pixels)
        row, column = np.divmod(np.arange(len(n)) - np.repeat(np.cumsum(pixels) - pixels, pixels), across[n])
        x, y = x0[n] + column, y0[n] + row
        wb, wc = b_x[n] * x + b_y[n] * y, c_x[n] * x + c_y[n] * y
        inside = np.flatnonzero((wb >= 0) & (wc >= 0) & (wb + wc <= 1))
        n, wb, wc = n[inside], wb[inside], wc[inside]
        at = (row[inside] + low[n, 1]) * width + column[inside] + low[n, 0]
        z = a[n, 2] + wb * bz[n] + wc * cz[n]
        # Of repeated pixels NumPy keeps the last value: the nearest, and of equals the first triangle.
        order = np.lexsort((-n, z))
        order = order[z[order] > depth[at[order]]]
        at, n, wb, wc = at[order], n[order], wb[order], wc[order]
        depth[at], nearest[at] = z[order], n
        weights[at] = np.stack([1.0 - wb - wc, wb, wc], -1)
    return depth.reshape(height, width), nearest.reshape(height, width), weights.reshape(height, width, 3)


def _cloth_color(positions: Floats, corners: Integers, weights: Floats, towards_eye: Floats) -> Floats:
    columns = positions.shape[1]
    along_rows, along_columns = np.gradient(positions, axis=(0, 1))
    normals = np.cross(along_rows, along_columns).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    normal = _blend(weights, normals, corners)
    front = normal @ towards_eye >= 0
    color = np.where(front[:, None], CLOTH_FRONT, CLOTH_BACK)
    cell = _blend(weights, np.stack(np.divmod(np.arange(len(normals)), columns), -1), corners)
    on_line = np.any(np.abs(cell - np.round(cell)) < GRID_LINE, axis=-1, keepdims=True)
    color = np.where(on_line, 0.72 * color, color)
    return _shade(color, np.where(front[:, None], normal, -normal), towards_eye)


def _shade(color: Floats, normals: Floats, towards_eye: Floats) -> Floats:
    """Two lights and an ambient term that is brighter from above; normals face the eye."""
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    ambient, above, key, eye = LIGHT
    light = ambient + above * normals[..., 1] + eye * np.maximum(normals @ towards_eye, 0)
    light += key * np.maximum(normals @ (KEY / np.linalg.norm(KEY)), 0)
    shaded: Floats = color * light[..., None]
    return shaded


def _redden(color: Floats, under: Floats) -> Floats:
    amount: Floats = np.where(np.greater(under, 0), LEAST_RED + (1 - LEAST_RED) * np.minimum(under / FULL_RED_DEPTH, 1), 0)
    amount = amount[:, None]
    red: Floats = color * (1 - amount) + PENETRATION * amount
    return red
