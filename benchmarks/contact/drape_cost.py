"""Cost of an offset over a step without spheres, on light drapes: mean and worst 50 steps."""

from __future__ import annotations

import time

import clothsim as cs
import numpy as np
from clothsim.typing import Offset

_WINDOW = 50  # steps


def _light(points: int) -> cs.Cloth:
    return cs.Cloth((points, points), mass=0.3, stiffness=100.0, damping=0.02, pins=())


def _ball(x: float, radius: float, z: float, friction: float = 0.3) -> cs.Sphere:
    """A sphere 1 mm below the sheet."""
    center = x, -radius - 1e-3, z
    return cs.Sphere(center, radius, response="continuous", friction=friction)


_DRAPE = cs.Cloth(
    (16, 16), mass=0.3, stiffness=200.0, damping=0.02, pins=(), springs=("structural", "shear")
)
_THREE = (_ball(0.3, 0.15, 0.3), _ball(0.7, 0.15, 0.4), _ball(0.45, 0.15, 0.7))
_MIDDLE = (_ball(0.5, 0.15, 0.5),)
# Cloth, spheres, speed of the fall [m/s], duration and time step [s].
SCENES = {
    "examples/drape.py": (_DRAPE, (_ball(0.5, 0.3, 0.5, 0.5),), 0.0, 0.4, 5e-4),
    "24 x 24 from rest": (_light(24), _MIDDLE, 0.0, 0.4, 2e-4),
    "24 x 24 at 5 m/s": (_light(24), _MIDDLE, 5.0, 0.2, 2e-4),
    "32 x 32 from rest": (_light(32), _MIDDLE, 0.0, 0.3, 2e-4),
    "32 x 32 at 5 m/s": (_light(32), _MIDDLE, 5.0, 0.2, 2e-4),
    "24 x 24, three spheres": (_light(24), _THREE, 0.0, 0.3, 2e-4),
    "the paper's cloth without pins": (
        cs.Cloth(pins=()),
        (_ball(0.5, 0.25, 0.5, 0.0),),
        0.0,
        0.3,
        2e-4,
    ),
}


def _per_step(stepper: cs.Stepper, dt: float) -> float:
    """Processor time of a step, which other work on the machine changes little [s]."""
    start = time.process_time()
    stepper.advance(_WINDOW, dt)
    return (time.process_time() - start) / _WINDOW


def drape_cost(name: str, offset: Offset = "cell") -> tuple[float, float]:
    """Mean and worst cost of a scene of `SCENES`, as multiples of a step without spheres."""
    cloth, balls, speed, duration, dt = SCENES[name]
    spheres = [ball.replace(offset=offset) for ball in balls]
    velocity = np.broadcast_to((0.0, -speed, 0.0), (*cloth.shape, 3))
    free, touched = (
        cs.Stepper(cs.Scene(cloth, s, velocity=velocity), threads=1) for s in ((), spheres)
    )
    alone = min(_per_step(free, dt) for _ in range(40))
    costs = np.array([_per_step(touched, dt) for _ in range(int(duration / dt / _WINDOW))]) / alone
    return float(costs.mean()), float(costs.max())
