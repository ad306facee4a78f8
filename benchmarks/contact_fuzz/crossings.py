"""Mass points fired at jumping spheres, checked in extended precision."""

from __future__ import annotations

from typing import Any

import clothsim as cs
import numpy as np
from clothsim.typing import Precision, Response

_POINTS = (250, 200)
_STEPS = 4  # with each sphere radius; a step starts where the one before ended
_ULP = np.finfo(np.float64).eps


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    n = rng.normal(size=(count, 3))
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


def _aimed(rng: np.random.Generator, p0: np.ndarray, radius: float) -> np.ndarray:
    """Random paths q from `p0` in the sphere's frame: past the centre at a chosen distance, or
    anywhere.

    Half of the paths come close to grazing, some to within 1e-12 radii. Their lengths go from 1e-6
    to 1e5 radii.
    """
    count = len(p0)
    distance = np.linalg.norm(p0, axis=1, keepdims=True)
    radial = p0 / distance
    aside = np.cross(radial, _directions(rng, count))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    miss = radius * rng.uniform(0, 1.3, (count, 1))
    near = rng.random((count, 1)) < 0.5
    sign = rng.choice((-1.0, 1.0), (count, 1))
    miss = np.where(near, radius * (1 + sign * 10 ** rng.uniform(-12, -1, (count, 1))), miss)
    sine = np.minimum(miss / distance, 1.0)
    way = -np.sqrt(1 - sine**2) * radial + sine * aside
    way = np.where(rng.random((count, 1)) < 0.2, _directions(rng, count), way)
    return way * radius * 10 ** rng.uniform(-6, 5, (count, 1))


def _closest(p0: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Least distance from the origin on the segments from p0 along q."""
    a = (q * q).sum(axis=-1)
    s = np.clip(-(p0 * q).sum(axis=-1) / np.where(a > 0, a, 1), 0, 1)
    return np.asarray(np.sqrt(((p0 + s[..., None] * q) ** 2).sum(axis=-1)))


def crossings(
    point_steps: int = 10**8,
    seed: int = 1,
    response: Response = "continuous",
    precision: Precision = "double",
) -> dict[str, Any]:
    """Fire free mass points at spheres that jump; count those that end inside or pass through.

    Radii go from 1e-2 to 10 m. Points and spheres move up to 1e5 radii per step, in new random
    directions each step. Half of them are aimed to graze. Each step is compared with the straight
    path in the sphere's frame, in the extended precision of `numpy.longdouble`. A path that enters
    the radius by more than the rounding of the inputs must get a response. From the impact on, the
    new path must lead outside.

    Parameters
    ----------
    point_steps : int
        Least number of point-steps (points times steps).
    seed : int
    response : str
        Response of the sphere. Other responses than "continuous" exist to see the check fail.
    precision : str
        Precision of the state. The check allows for the rounding of "single".

    Returns
    -------
    dict
        "point_steps", "hits" (ways that meet the sphere), "inside" (points inside afterwards),
        "crossings" and "deepest" [radii], the deepest that a point was inside.
    """
    rng = np.random.default_rng(seed)
    count = _POINTS[0] * _POINTS[1]
    cloth = cs.Cloth(_POINTS, stiffness=0.0, damping=0.0, pins=())
    total = {"point_steps": 0, "hits": 0, "inside": 0, "crossings": 0, "deepest": 0.0}
    dt = 2.0**-10
    wide = np.longdouble
    # Relative: of a way, and of a velocity that nothing has changed.
    slack, same = {"double": (8 * _ULP, 0.0), "single": (2.0**-21, 2.0**-40)}[precision]
    while total["point_steps"] < point_steps:
        radius = 10 ** rng.uniform(-2, 1)
        material = {"restitution": rng.choice((0.0, 0.5, 1.0)), "friction": rng.choice((0.0, 0.4))}
        center = rng.normal(size=3)
        x = center + radius * (1 + 10 ** rng.uniform(-9, 3, (count, 1))) * _directions(rng, count)
        for _ in range(_STEPS):
            jump = _directions(rng, 1)[0] * radius * 10 ** rng.uniform(-6, 5)
            jump *= rng.random() < 0.8
            end = center + jump
            sphere = cs.Sphere(
                center, radius, cs.Keyframes((0.0, dt), (center, end)), response, "none", **material
            )
            q = _aimed(rng, x - center, radius)
            v = (q + jump) / dt
            with_cloth = cs.Scene(cloth, sphere, gravity=(0, 0, 0))
            shape = (*_POINTS, 3)
            state = x.reshape(shape), v.reshape(shape)
            x1, v1 = cs.step(with_cloth, *state, dt, t=0.0, threads=1, precision=precision)
            x1, v1 = x1.reshape(-1, 3), v1.reshape(-1, 3)

            p0 = x.astype(wide) - center
            way = (x.astype(wide) + dt * v.astype(wide) - end) - p0
            p1 = x1.astype(wide) - end
            # What the rounding of x, of dt v and of the sums may move the way by.
            rounding = slack * (
                np.abs(x).max(axis=1) + np.abs(dt * v).max(axis=1) + np.abs(end).max()
            )
            meets = _closest(p0, way) < radius - rounding
            distance = np.sqrt((p1**2).sum(axis=1))
            inside = distance < radius
            unanswered = meets & (np.abs(v1 - v) <= same * np.abs(v)).all(axis=1)
            unanswered |= meets & (_closest(*_after(p0, way, p1, radius)) < radius - 2 * rounding)
            total["point_steps"] += count
            total["hits"] += int(meets.sum())
            total["inside"] += int(inside.sum())
            total["crossings"] += int(unanswered.sum())
            total["deepest"] = max(total["deepest"], float((radius - distance).max() / radius))

            # Who is far away, or inside by a response that lets it, is fired from somewhere new.
            gone = (distance > 1e3 * radius) | inside
            center = end
            fresh = center + radius * (1 + 10 ** rng.uniform(-9, 3, (count, 1))) * _directions(
                rng, count
            )
            x = np.where(gone[:, None], fresh, x1)
    return total


def _after(
    p0: np.ndarray, way: np.ndarray, p1: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Start and direction of the path after the first contact, which leads straight to p1."""
    a, b = (way * way).sum(axis=1), (p0 * way).sum(axis=1)
    nearest = p0 + (-b / np.where(a > 0, a, 1))[:, None] * way
    below = np.maximum(radius**2 - (nearest**2).sum(axis=1), 0)
    time = -b / np.where(a > 0, a, 1) - np.sqrt(below / np.where(a > 0, a, 1))
    place = p0 + np.clip(time, 0, 1)[:, None] * way
    # On the surface: rounding of a way of 1e5 radii must not pass for depth.
    distance = np.sqrt((place**2).sum(axis=1, keepdims=True))
    place = place * np.maximum(radius / np.where(distance > 0, distance, 1), 1)
    return place, p1 - place
