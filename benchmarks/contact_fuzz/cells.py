"""Spheres shot at sheets with offset "cell": every step is judged by exact depths of triangles."""

from __future__ import annotations

import warnings
from typing import Any

import clothsim as cs
import numpy as np

_STEPS = 30  # of a shot


def _shot(rng: np.random.Generator) -> tuple[cs.Scene, float, dict[str, Any]]:
    """A sheet without pins, a sphere of 1.5 to 30 cell radii just above, a time step, options."""
    points = int(rng.integers(2, 14))
    cloth = cs.Cloth(
        (points, points),
        mass=float(0.05 * points**2 * 10 ** rng.uniform(-1, 1)),
        stiffness=float(10 ** rng.uniform(1, 4)),
        damping=float(10 ** rng.uniform(-2, 0)),
        pins=(),
    )
    integrator = str(rng.choice(list(cs.integrators())))
    free = cs.Scene(cloth)
    limit = cs.max_stable_dt(free, integrator) or 0.02 * cs.max_stable_dt(
        free
    )  # "explicit_euler" may have none
    dt = min(10 ** rng.uniform(-5, -3), 0.4 * limit)
    radius = float(np.hypot(*cloth.spacing) / 2 * 1.5 * 10 ** rng.uniform(0, 1.3))
    speed = 10 ** rng.uniform(0, 2)
    way = rng.normal(size=3) * (0.4, 0, 0.4) + (0, -1, 0)
    way /= np.linalg.norm(way)
    aim = rng.uniform(0, 1, 3) * (1, 0, 1)
    sphere = cs.Sphere(
        aim,
        radius,
        response="continuous",
        restitution=float(rng.choice((0.0, 0.5, 1.0))),
        friction=float(rng.choice((0.0, 0.4))),
    )
    back = 1.01 * sphere.contact_radius(cloth) / -way[1] + rng.uniform(0, 1) * speed * dt
    sphere = sphere.replace(center=tuple(aim - way * back), motion=cs.Linear(way * speed))
    options = {
        "integrator": integrator,
        "precision": str(rng.choice(("single", "double"))),
        "threads": 1,
    }
    return cs.Scene(cloth, sphere), dt, options


def _half_diagonal(x: np.ndarray) -> float:
    """Half the longest diagonal of a cell, which its radius is not below [m]."""
    falling, rising = x[1:, 1:] - x[:-1, :-1], x[1:, :-1] - x[:-1, 1:]
    return float(max(np.linalg.norm(d, axis=-1).max() for d in (falling, rising))) / 2


def cells(count: int = 300, seed: int = 1) -> dict[str, Any]:
    """Shoot spheres at 1 to 100 m/s at sheets and measure the deepest triangle of every step.

    Parameters
    ----------
    count : int
        Shots.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    dict
        "shots"; "hits": shots that moved the sheet; "too_large": with a cell that grew larger than
        the sphere, which are judged until then; "unstable": ended with an `UnstableError` of
        "explicit_euler"; "inside": with a triangle inside; "deepest" [m]; "far": with a point
        farther off than the ways of sheet and sphere allow.
    """
    rng = np.random.default_rng(seed)
    total: dict[str, Any] = {
        "shots": 0,
        "hits": 0,
        "too_large": 0,
        "unstable": 0,
        "inside": 0,
        "deepest": 0.0,
        "far": 0,
    }
    while total["shots"] < count:
        scene, dt, options = _shot(rng)
        sphere = scene.spheres[0]
        total["shots"] += 1
        deepest = far = 0.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cs.OrderWarning)
            warnings.simplefilter("error", cs.ContactWarning)
            stepper = cs.Stepper(scene, **options)
            try:
                for _ in range(_STEPS):
                    stepper.advance(1, dt)
                    if _half_diagonal(stepper.positions) > sphere.radius:
                        total["too_large"] += 1
                        break
                    deepest = max(
                        deepest,
                        cs.penetration(stepper.positions, sphere, stepper.time)["triangles"],
                    )
            except cs.ContactWarning:
                total["too_large"] += 1
            except cs.UnstableError:
                total["unstable"] += 1
        speed = np.linalg.norm(sphere.velocity_at(0))
        far = (
            np.abs(stepper.positions - scene.cloth.rest_positions).max()
            > 2 * sphere.radius + 4 * speed * stepper.time
        )
        total["inside"] += deepest > 0
        total["deepest"] = max(total["deepest"], deepest)
        total["far"] += bool(far)
        total["hits"] += bool(np.abs(stepper.velocities).max() > 0.1)
    return total
