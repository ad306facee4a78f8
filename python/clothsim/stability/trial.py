"""Whether a scene is stable at a time step, measured: real runs from a slightly disturbed state.

Physics adds no energy to a cloth without moving spheres. If the energy of a run rises, the time step has made it. The
free points get random velocities, which contain every mode and are far too slow to matter for the motion. Above the
limit some modes grow by a part of themselves each step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.stepper import SilentStepper
from ..errors import UnstableError
from ..measure.measures import energy
from ..model.scene import Scene

Floats = npt.NDArray[np.float64]

STEPS = 1000
_CHECKED = 10  # steps; what has grown may find a folded shape, in which it is stable, and die away
_DISTURBANCE = 1e-6  # of the shortest distance of neighbours, per time step
_GROWTH = 1e3  # of the disturbance, that counts as unstable
_ENERGY_ERROR = 0.01  # of kinetic and elastic energy, that an honest run may be off


def is_stable(scene: Scene, x: Floats, v: Floats, dt: float, steps: int = STEPS, **options: Any) -> bool:
    """Whether the total energy does not rise in `steps` steps of `dt` from a disturbed (x, v).

    Spheres are left out, because they can do work on the cloth. `options` are options of `Stepper`.
    """
    cloth = scene.cloth
    scene = scene.replace(spheres=())
    spacing = min(h for h in cloth.spacing if h > 0)
    speed = _DISTURBANCE * spacing / dt
    noise = speed * np.random.default_rng(0).normal(size=x.shape) * ~cloth.pinned[..., None]
    size = (cloth.mass_per_point[..., None] * noise**2).sum() / 2
    start = energy(scene, x, v + noise)
    stepper = SilentStepper(scene, x, v + noise, **{"threads": 1, **options})
    stepper._state.judge.warned_of_dt = True
    for done in range(0, steps, _CHECKED):
        try:
            stepper.advance(min(_CHECKED, steps - done), dt)
        except UnstableError:
            return False
        now = energy(scene, stepper.positions, stepper.velocities)
        allowed = _GROWTH**2 * size + _ENERGY_ERROR * (now["kinetic"] + now["elastic"])
        if not now["total"] - start["total"] <= allowed:
            return False
    return True
