"""A depth-buffered picture of a cloth and its spheres, orthographic, in NumPy alone.

Painter-sorted triangles cannot show contact: cloth and sphere lie tenths of a millimetre apart and
their triangles are a hundred times larger than that. Here each pixel keeps the nearest cloth point
and spheres are intersected exactly, so a patch where the sphere's surface lies above the cloth is
seen as what it is, and is painted red by its depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BACKGROUND = np.array([1.0, 1.0, 1.0])
CLOTH_FRONT = np.array([0.27, 0.47, 0.72])
CLOTH_BACK = np.array([0.87, 0.73, 0.45])
SPHERE = np.array([0.80, 0.81, 0.83])
PIN = np.array([0.15, 0.15, 0.15])
PENETRATION = np.array([0.86, 0.08, 0.10])
FULL_RED_DEPTH = 0.010  # m; cloth this deep under the sphere's surface is painted fully red
GRID_LINE = 0.05  # half width of a drawn grid line, in cells


@dataclass(frozen=True)
class Camera:
    """An orthographic view: `direction` points from the scene to the eye, sizes are in metres."""

    direction: tuple[float, float, float]
    target: tuple[float, float, float]
    width: float
    height: float

    def axes(self) -> np.ndarray:
        """Right, up and towards-the-eye unit vectors, one a row, shape (3, 3)."""
        depth = np.array(self.direction, float)
        depth /= np.linalg.norm(depth)
        right = np.cross((0.0, 1.0, 0.0), depth)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(depth, right), depth])

    @classmethod
    def around(cls, direction, points, margin: float = 0.03) -> Camera:
        """The view along `direction` that holds `points`, shape (n, 3), no taller than wide."""
        axes = cls(direction, (0.0, 0.0, 0.0), 1.0, 1.0).axes()
        seen = np.asarray(points, float).reshape(-1, 3) @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        width, height = (high - low)[:2] + 2 * margin * (high - low)[:2].max()
        return cls(direction, tuple(0.5 * (low + high) @ axes), max(width, height), height)


@dataclass(frozen=True)
class Ball:
    """A sphere to draw; the cloth inside it is painted red where `solid`."""

    center: tuple[float, float, float]
    radius: float
    color: np.ndarray
    solid: bool = True


def render(positions, triangles, balls, camera: Camera, width: int = 520, samples: int = 2):
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

    def to_screen(points):
        seen = (np.asarray(points, float) - camera.target) @ axes.T
        return np.stack(
            [width / 2 + scale * seen[..., 0], height / 2 - scale * seen[..., 1], seen[..., 2]], -1
        )

    screen = to_screen(positions.reshape(-1, 3))
    depth, nearest, weights = _nearest_triangles(screen, triangles, width, height)
    picture = np.broadcast_to(BACKGROUND, (height, width, 3)).copy()

    hit = nearest >= 0
    corners = triangles[nearest[hit]]
    fragments = np.einsum("nk,nkc->nc", weights[hit], positions.reshape(-1, 3)[corners])
    picture[hit] = _cloth_color(positions, corners, weights[hit], axes[2])

    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    for ball in balls:
        x, y, z = to_screen(ball.center)
        u, v = (columns - x) / (scale * ball.radius), (y - rows) / (scale * ball.radius)
        inside = 1.0 - u * u - v * v
        half = np.sqrt(np.maximum(inside, 0.0))
        front = z + ball.radius * half
        drawn = (inside > 0) & (front > depth)
        normals = np.stack([u[drawn], v[drawn], half[drawn]], -1) @ axes
        color = _shade(ball.color, normals, axes[2])
        if ball.solid:
            under = np.zeros((height, width))
            under[hit] = ball.radius - np.linalg.norm(fragments - ball.center, axis=-1)
            under[depth < z] = 0.0  # cloth on the far half is not what the eye meets here
            color = _redden(color, under[drawn])
        picture[drawn] = color
        depth[drawn] = front[drawn]

    picture = picture.reshape(size[1], samples, size[0], samples, 3).mean(axis=(1, 3))
    return np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)


def _nearest_triangles(screen, triangles, width, height):
    """Per pixel: depth (towards the eye), triangle number or -1, barycentric weights."""
    depth = np.full((height, width), -np.inf)
    nearest = np.full((height, width), -1)
    weights = np.zeros((height, width, 3))
    for number, (a, b, c) in enumerate(screen[triangles]):
        low = np.floor(np.minimum(np.minimum(a, b), c)[:2]).astype(int).clip(0)
        high = np.ceil(np.maximum(np.maximum(a, b), c)[:2]).astype(int)
        x1, y1 = min(high[0], width), min(high[1], height)
        twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice_area == 0 or low[0] >= x1 or low[1] >= y1:
            continue
        x = np.arange(low[0], x1) + 0.5
        y = (np.arange(low[1], y1) + 0.5)[:, None]
        wb = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice_area
        wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice_area
        wa = 1.0 - wb - wc
        z = wa * a[2] + wb * b[2] + wc * c[2]
        box = np.s_[low[1] : y1, low[0] : x1]
        visible = (wa >= 0) & (wb >= 0) & (wc >= 0) & (z > depth[box])
        depth[box][visible] = z[visible]
        nearest[box][visible] = number
        weights[box][visible] = np.stack([wa, wb, wc], -1)[visible]
    return depth, nearest, weights


def _cloth_color(positions, corners, weights, towards_eye):
    columns = positions.shape[1]
    along_rows, along_columns = np.gradient(positions, axis=(0, 1))
    normals = np.cross(along_rows, along_columns).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    normal = np.einsum("nk,nkc->nc", weights, normals[corners])
    front = normal @ towards_eye >= 0
    color = np.where(front[:, None], CLOTH_FRONT, CLOTH_BACK)
    grid = np.stack(np.divmod(corners, columns), -1)
    cell = np.einsum("nk,nkc->nc", weights, grid)
    on_line = (np.abs(cell - np.round(cell)) < GRID_LINE).any(axis=-1)
    color = np.where(on_line[:, None], 0.72 * color, color)
    return _shade(color, np.where(front[:, None], normal, -normal), towards_eye)


def _shade(color, normals, towards_eye):
    """Two lights and an ambient term that is brighter from above; normals face the eye."""
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
    key = np.array([0.3, 1.0, 0.25]) / np.linalg.norm([0.3, 1.0, 0.25])
    light = (
        0.46
        + 0.10 * normals[..., 1]
        + 0.32 * np.maximum(normals @ key, 0)
        + 0.28 * np.maximum(normals @ towards_eye, 0)
    )
    return color * light[..., None]


def _redden(color, under):
    amount = np.where(under > 0, 0.35 + 0.65 * np.minimum(under / FULL_RED_DEPTH, 1), 0)[:, None]
    return color * (1 - amount) + PENETRATION * amount
