"""Curves of a run over its stored frames: energy, stretch, penetration and contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..model.scene import Scene

Curves = dict[str, npt.NDArray[np.float64]]

TOUCH = 1 / 32
"""A mass point touches a sphere if it is closer to it than the contact radius and this part of the
spacing: 1 mm for 32 points on a metre. Half of it misses points that bounce while they rest, twice
of it counts points that only pass."""


def touching(scene: Scene, x: npt.NDArray[np.float64], t: float) -> int:
    """Number of mass points that touch a sphere at the time `t`."""
    near = TOUCH * max(scene.cloth.spacing)
    touched = np.zeros(scene.cloth.shape, bool)
    for sphere in scene.spheres:
        distance = np.linalg.norm(x - sphere.center_at(t), axis=-1)
        touched |= distance <= sphere.contact_radius(scene.cloth) + near
    return int(touched.sum())


def curves(run: Any) -> Curves:
    """Each curve, shape (frames,).

    "kinetic", "elastic", "gravity" and "total" [J]; "stretch" of the most stretched spring, l/L - 1;
    "points" and "triangles", the deepest of each below the true radius of any sphere [m]; "contacts",
    the number of mass points that touch a sphere. Without a sphere the last three are missing.
    """
    found: Curves = {**run.energy(), "stretch": run.stretch()["largest"]}
    if run.scene.spheres:
        found |= run.penetration()
        pairs = zip(run.x, run.t, strict=True)
        found["contacts"] = np.array([touching(run.scene, x, float(t)) for x, t in pairs], float)
    return found
