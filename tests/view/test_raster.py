"""Pictures of the core against rays: each sample of each pixel is followed into a small scene with NumPy alone."""

from dataclasses import replace

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing import raster
from clothsim.viewing.camera import Camera
from clothsim.viewing.raster import Ball, render


def rays(camera, width, height, n=raster.SAMPLES):
    """Start and direction of the ray of each sample, by pixel: shape (height, width, n, n, 3)."""
    right, up, eye = camera.axes()
    across = camera.width * ((np.arange(n * width) + 0.5) / (n * width) - 0.5)
    down = camera.width / width * height * (0.5 - (np.arange(n * height) + 0.5) / (n * height))
    plane = np.asarray(camera.target) + across[:, None] * right + down[:, None, None] * up
    if camera.distance is not None:
        start = np.broadcast_to(np.asarray(camera.target) + camera.distance * eye, plane.shape)
        direction = plane - start
    else:
        start, direction = plane + 100 * eye, np.broadcast_to(-eye, plane.shape)
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return [part.reshape(height, n, width, n, 3).swapaxes(1, 2) for part in (start, direction)]


def through_sheet(start, direction, x, triangles):
    """Distance, corners and weights of the first triangle along each ray (Moeller and Trumbore)."""
    a, b, c = np.moveaxis(x.reshape(-1, 3)[triangles], 1, 0)
    p = np.cross(direction[:, None], c - a)
    determinant = ((b - a) * p).sum(-1)
    s = start[:, None] - a
    u = (s * p).sum(-1) / determinant
    q = np.cross(s, b - a)
    v = (q * direction[:, None]).sum(-1) / determinant
    far = (q * (c - a)).sum(-1) / determinant
    far[~((u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0))] = np.inf
    first = far.argmin(axis=1)
    k = np.arange(len(start)), first
    return far[k], triangles[first], np.stack([1 - u[k] - v[k], u[k], v[k]], -1)


def through_ball(start, direction, ball):
    """Distance along each ray to a ball."""
    way = start - ball.center
    b, c = (way * direction).sum(-1), (way * way).sum(-1) - ball.radius**2
    with np.errstate(invalid="ignore"):
        far = -b - np.sqrt(b * b - c)
    return np.where(np.isnan(far), np.inf, far)


def shaded(color, normal, direction):
    ambient, above, key, eye = raster.LIGHT
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    light = ambient + above * normal[:, 1] + eye * np.maximum(-(normal * direction).sum(-1), 0)
    return color * (light + key * np.maximum(normal @ (raster.KEY / np.linalg.norm(raster.KEY)), 0))[:, None]


def traced(x, balls, camera, width, colors=None):
    """The picture of `render`, by rays."""
    height = max(1, round(width * camera.height / camera.width))
    start, direction = rays(camera, width, height)
    shape = start.shape
    start, direction = start.reshape(-1, 3), direction.reshape(-1, 3)
    columns = x.shape[1]
    far, corners, weights = through_sheet(start, direction, x, cs.triangles(x.shape[:2]))

    def blended(values):
        return (weights[..., None] * np.asarray(values, float)[corners]).sum(1)

    normal = np.cross(*np.gradient(x, axis=(0, 1))).reshape(-1, 3)
    normal = blended(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    front = -(normal * direction).sum(-1, keepdims=True) >= 0
    color = np.where(front, raster.CLOTH_FRONT, raster.CLOTH_BACK) if colors is None else blended(colors.reshape(-1, 3))
    cell = blended(np.stack(np.divmod(np.arange(x[..., 0].size), columns), -1))
    line = (np.abs(cell - cell.round()) < raster.GRID_LINE).any(-1, keepdims=True)
    color = shaded(np.where(line, 0.72 * color, color), np.where(front, normal, -normal), direction)
    color[np.isinf(far)] = raster.BACKGROUND
    place, slack = blended(x.reshape(-1, 3)), 1e-5 * camera.width
    sheet, nearest = far.copy(), far
    for ball in balls:
        here = through_ball(start, direction, ball)
        with np.errstate(invalid="ignore"):
            normals = (start + here[:, None] * direction - ball.center) / ball.radius
            here = here + slack / np.maximum(-(normals * direction).sum(-1), 0.05)
        under = ball.radius - np.linalg.norm(place - ball.center, axis=-1) - slack
        middle = (start - ball.center) @ camera.axes()[2]  # cloth in the far half is not painted
        middle = middle / -(direction @ camera.axes()[2])
        seen = np.isfinite(sheet) & (nearest <= middle) & ball.solid & (under > 0)
        red = np.where(seen, raster.LEAST_RED + (1 - raster.LEAST_RED) * np.minimum(under / raster.FULL_RED_DEPTH, 1), 0)
        drawn = here < nearest
        painted = shaded(ball.color, normals[drawn], direction[drawn])
        part = red[drawn, None]
        color[drawn] = painted * (1 - part) + raster.PENETRATION * part
        nearest = np.minimum(nearest, here)
    samples = color.astype(np.float32).reshape(*shape)
    return np.round(255 * samples.mean(axis=(2, 3))).clip(0, 255).astype(np.uint8)


def crumpled(seed, shape=(7, 9)):
    """A sheet that crosses itself and the two balls."""
    rng = np.random.default_rng(seed)
    x = cs.Cloth(shape, pins=()).rest_positions + rng.normal(0, 0.08, (*shape, 3))
    balls = [
        Ball((0.5, -0.3, 0.5), 0.35, raster.SPHERE),
        Ball((0.8, 0.1, 0.3), 0.2, raster.SPHERE),
        Ball(x[0, 0], 0.03, raster.PIN, solid=False),
    ]
    return x, balls, rng


def differing(a, b):
    return int((a != b).any(axis=-1).sum())


@pytest.mark.parametrize("seed", range(6))
def test_every_pixel_is_that_of_rays(seed):
    x, balls, rng = crumpled(seed)
    camera = Camera.around(rng.normal(size=3), x)
    assert differing(render(x, balls, camera, 90), traced(x, balls, camera, 90)) == 0


@pytest.mark.parametrize("seed", range(3))
def test_every_pixel_in_perspective_is_that_of_rays(seed):
    x, balls, rng = crumpled(seed)
    camera = replace(Camera.around(rng.normal(size=3), x), distance=1.6)
    drawn, expected = render(x, balls, camera, 90), traced(x, balls, camera, 90)
    assert differing(drawn, expected) <= 2  # a sample on an edge
    assert differing(drawn, render(x, balls, replace(camera, distance=None), 90)) > 1000


def test_colours_of_mass_points_are_interpolated():
    x, balls, rng = crumpled(8)
    colors, camera = rng.uniform(size=x.shape), Camera.around((1, 2, 3), x)
    assert differing(render(x, balls, camera, 90, colors=colors), traced(x, balls, camera, 90, colors)) == 0


def test_points_behind_the_eye_are_not_drawn():
    x = cs.Cloth((7, 9), pins=()).rest_positions
    balls = [Ball((0.5, 3.0, 0.5), 0.3, raster.SPHERE)]
    camera = Camera((0, 1, 0), (0.5, 0.0, 0.5), 1.2, 1.2, distance=2.0)
    assert differing(render(x, balls, camera, 90), render(x, [], camera, 90)) == 0
    assert (render(x + (0, 2.5, 0), [], camera, 90) == 255).all()


@pytest.mark.parametrize("shadow", [False, True])
def test_pixels_are_the_same_for_every_number_of_threads(shadow):
    x, balls, _ = crumpled(1)
    planes = [raster.Plane((0.5, -0.8, 0.5), 1.0)]
    camera = Camera.around((1.0, 0.6, 1.3), x)
    whole, *others = (render(x, balls, camera, 301, planes=planes, shadow=shadow, threads=n) for n in (1, 2, 5))
    assert all(np.array_equal(whole, one) for one in others)
