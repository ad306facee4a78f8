"""Curves of a run over its stored frames: energy, stretch, penetration and contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..model.scene import Scene

Curves = dict[str, npt.NDArray[np.float64]]

PARTS = 4  # kinds of measures, each of all frames

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


def curves(run: Any, advance: Callable[[int], object] = lambda _: None) -> Curves:
    """Each curve, shape (frames,). `advance` advances by `PARTS` for every frame.

    "kinetic", "elastic", "gravity", "force" and "total" [J]; "stretch" of the most stretched spring, l/L - 1;
    "points" and "triangles", the deepest of each below the true radius of any sphere [m]; "contacts",
    the number of mass points that touch a sphere. Without a sphere the last three are missing.
    """
    found: Curves = dict(run.energy())
    advance(len(run.t))
    found["stretch"] = run.stretch()["largest"]
    advance(len(run.t))
    if run.scene.spheres:
        found |= run.penetration()
    advance(len(run.t))
    if run.scene.spheres:
        pairs = zip(run.x, run.t, strict=True)
        found["contacts"] = np.array([touching(run.scene, x, float(t)) for x, t in pairs], float)
    advance(len(run.t))
    return found
