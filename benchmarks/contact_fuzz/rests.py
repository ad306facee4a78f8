"""Random sheets that lie on spheres: do they come to rest?"""

from __future__ import annotations

from typing import Any

import clothsim as cs
import numpy as np
from contact.oracle import corner_indices, nearest_places
from contact.physics import on_sphere

QUIET = 1e-5  # m/s


def _lying(rng: np.random.Generator, restitution: float) -> tuple[cs.Scene, float]:
    """A sheet on a sphere of 0.1 to 10 m, with more friction than its slope asks for, and a time step."""
    points, radius = int(rng.integers(3, 15)), float(10 ** rng.uniform(-1, 1))
    width, mass = float(radius * rng.uniform(0.1, 0.4)), float(1e-3 * points**2 * 10 ** rng.uniform(-1, 1))
    drag = float(rng.uniform(20, 40)) * mass / points**2
    stiffness = float(10 ** rng.uniform(2, 3.5))
    cloth = cs.Cloth((points, points), (width, width), mass, stiffness, 0.0, drag, pins=())
    friction = float(rng.uniform(0.5, 1))
    sphere = cs.Sphere((0, -radius, 0), radius, None, "continuous", "face", restitution, friction)
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth), float(rng.uniform(0, 0.2)))
    scene = cs.Scene(cloth, sphere, position=x)
    return scene, min(1e-4, 0.25 * cs.max_stable_dt(scene))


def rests(count: int = 20, seed: int = 1, restitution: float = 0.0, duration: float = 3.0) -> dict[str, Any]:
    """Let random sheets settle on spheres, and look how fast they are in the end.

    Parameters
    ----------
    count : int
        Sheets.
    seed : int
        Seed of the random numbers.
    restitution : float
        Restitution of the spheres.
    duration : float
        Simulated time [s].

    Returns
    -------
    dict
        "sheets"; "quiet": sheets whose largest speed at the end is below 1e-5 m/s; "median" and "worst" of these speeds
        [m/s]; "depth": the deepest of any triangle at the end [m].
    """
    rng = np.random.default_rng(seed)
    speeds, depth = [], 0.0
    for _ in range(count):
        scene, dt = _lying(rng, restitution)
        stepper = cs.Stepper(scene, threads=1)
        stepper.advance(round(duration / dt), dt)
        speeds.append(float(np.linalg.norm(stepper.velocities, axis=-1).max()))
        sphere = scene.spheres[0]
        centred = stepper.positions.reshape(-1, 3)[corner_indices(scene.cloth.shape)] - np.array(sphere.center)
        depth = max(depth, sphere.radius - float(nearest_places(centred)[1].min()))
    return {
        "sheets": count,
        "quiet": int((np.array(speeds) < QUIET).sum()),
        "median": float(np.median(speeds)),
        "worst": max(speeds),
        "depth": max(0.0, depth),
    }
