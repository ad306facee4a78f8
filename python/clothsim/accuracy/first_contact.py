"""The first contact of a freely moving cloth with a sphere, if there is one."""

from __future__ import annotations

import math

import numpy as np

from ..engine.stepper import Stepper
from ..methods.bound import stable_dt
from ..model.scene import Scene

# Of the time in which the cloth's size is crossed: how far apart the looks are at most.
_MOST_BETWEEN = 1e-4  # s


def first_contact(scene: Scene, duration: float) -> tuple[float, int] | None:
    """Earliest time at which a mass point comes as close to a sphere as its contact radius [s], and the sphere's index.

    None without contact up to `duration`. The cloth moves freely, by RK4. Between two samples a point counts as near as its
    speed relative to the sphere allows. So no contact is missed, and a near miss within that distance counts as a contact.
    """
    if not scene.spheres:
        return None
    free = ~scene.cloth.pinned
    stepper = Stepper(scene.replace(spheres=()), threads=1)
    between = min(_MOST_BETWEEN, 0.5 * stable_dt(scene), duration)
    count = math.ceil(duration / between)
    dt = duration / count
    for n in range(count + 1):
        t = n * dt
        x, v = stepper.positions[free], stepper.velocities[free]
        for k, sphere in enumerate(scene.spheres):
            center = sphere.center_at(t)
            distance = np.linalg.norm(x - center, axis=-1)
            speed = np.linalg.norm(v - sphere.velocity_at(t), axis=-1)
            if (distance < sphere.contact_radius(scene.cloth) + speed * dt).any():
                return t, k
        if n < count:
            stepper.advance(1, dt)
    return None
