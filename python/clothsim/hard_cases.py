"""Scenes that strain the method or the arithmetic, each with the settings of its run.

`tests/hard_cases` runs them all and judges how they end; docs/stability.md tells the outcomes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.typing import Precision

from .base import Floats

__all__ = ["HardCase", "hard_cases"]


@dataclass(frozen=True)
class HardCase:
    """A scene that is difficult for the method or the arithmetic.

    Attributes
    ----------
    scene : Scene
    dt : float
        Time step [s].
    steps : int
        Number of steps.
    why : str
        The difficulty.
    precisions : tuple of str
        Precisions that the case is meant for.
    unstable : bool
        Whether an `UnstableError` is the expected outcome.
    """

    scene: cs.Scene
    dt: float
    steps: int
    why: str
    precisions: tuple[Precision, ...] = ("double", "single")
    unstable: bool = False


NO_GRAVITY = (0.0, 0.0, 0.0)


def half_kilogram_cloth(shape: tuple[int, int] = (8, 8), **changes: Any) -> cs.Cloth:
    """Make a cloth of half a kilogram a point, undamped and pinned at two corners, but for
    `changes`.
    """
    mass = 0.5 * shape[0] * shape[1]
    arguments: dict[str, Any] = {"shape": shape, "mass": mass, "damping": 0.0, **changes}
    return cs.Cloth(**arguments)


def random_displacements(cloth: cs.Cloth, size: float) -> Floats:
    """Draw random displacements of the free points [m]."""
    displacements = np.random.default_rng(0).normal(scale=size, size=(*cloth.shape, 3))
    return displacements * ~cloth.pinned[..., None]


def stiffness_cases() -> dict[str, HardCase]:
    """Make cases of springs of 1e6 to 1e12 N/m, and of 1e7 beside 1 N/m."""
    cases = {}
    for k in (1e6, 1e9, 1e12):
        cloth = half_kilogram_cloth(stiffness=k, damping=1e-3 * k**0.5)
        scene = cs.Scene(cloth, position=cloth.rest_positions + random_displacements(cloth, 1e-3))
        cases[f"stiffness {k:.0e} N/m".replace("e+", "e")] = HardCase(
            scene,
            dt=0.9 * cs.max_stable_dt(scene),
            steps=1000,
            why="waves of a thousand to a million Hz beside gravity",
        )
    for strong in ("structural", "shear"):
        families = dict.fromkeys(("structural", "shear", "bend"), 1.0)
        families[strong] = 1e7
        scene = cs.Scene(half_kilogram_cloth(stiffness=families))
        cases[f"{strong} springs of 1e7 beside 1 N/m"] = HardCase(
            scene,
            dt=0.9 * cs.max_stable_dt(scene),
            steps=2000,
            why="one family is 10 million times stiffer than the others",
        )
    return cases


@cache  # The eigenvalues of a dense matrix take a second.
def time_step_cases() -> dict[str, HardCase]:
    """Make cases right below and right above the limit, of very small and of very many steps."""
    cloth = half_kilogram_cloth(stiffness=900.0)
    scene = cs.Scene(cloth, gravity=NO_GRAVITY, velocity=random_displacements(cloth, 1e-5))
    limit = cs.max_stable_dt(scene, x=cloth.rest_positions) / 0.97  # which is 3 % below the limit
    return {
        "dt at 0.95 of the limit": HardCase(
            scene, dt=0.95 * limit, steps=4000, why="every wave turns by almost half a turn a step"
        ),
        "dt at 1.05 of the limit": HardCase(
            scene,
            dt=1.05 * limit,
            steps=4000,
            why="the fastest wave grows by two fifths a step",
            unstable=True,
        ),
        "dt 5e-6 s in single": HardCase(
            cs.Scene(half_kilogram_cloth((12, 12), damping=100.0)),
            dt=5e-6,
            steps=50_000,
            why="a step moves a point by less than float32 can tell",
            precisions=("single",),
        ),
        "a million steps": HardCase(
            drum_scene((4, 4), damping=0.0), dt=5e-6, steps=1_000_000, why="rounding adds up"
        ),
        "a million steps in single": HardCase(
            drum_scene((4, 4)),
            dt=5e-6,
            steps=1_000_000,
            why="rounding adds up, in float32 at steps that float32 alone could not take",
            precisions=("single",),
        ),
    }


def drum_scene(shape: tuple[int, int], damping: float = 100.0) -> cs.Scene:
    """Make a cloth with the paper's springs and masses, stretched by a tenth and pinned along its
    border.

    It swings in gravity without folding, so that rounding is not amplified: two computations of it
    can be compared after any time.
    """
    clamped = np.ones(shape, bool)
    clamped[1:-1, 1:-1] = False
    cloth = half_kilogram_cloth(shape, pins=clamped, damping=damping)
    return cs.Scene(cloth, position=1.1 * cloth.rest_positions)


def mass_cases() -> dict[str, HardCase]:
    """Make cases of one light and of one heavy point."""
    cases = {}
    for name, ratio in (("lighter", 1e-6), ("heavier", 1e6)):
        mass = np.ones((8, 8))
        mass[3, 4] = ratio
        scene = cs.Scene(half_kilogram_cloth(mass=mass, stiffness=1000.0))
        cases[f"a point 1e6 times {name}"] = HardCase(
            scene,
            dt=0.9 * cs.max_stable_dt(scene),
            steps=2000,
            why="one point is a thousand times faster or slower than the others",
        )
    return cases


FAR = (1e6, 1e6, 1e6)  # m, of the case "1e6 m away"


def near_cloth_scene() -> cs.Scene:
    """Make the scene that the case "1e6 m away" has elsewhere."""
    cloth = half_kilogram_cloth(stiffness=1000.0, damping=1.0)
    return cs.Scene(cloth, cs.Sphere((0.5, -0.4, 0.5), 0.25, offset="none", response="ray"))


def geometry_cases() -> dict[str, HardCase]:
    """Make cases of coincident points, springs of zero length, narrow cloths, and positions far
    from the origin.
    """
    tiny = half_kilogram_cloth(size=(1e-300, 1e-300), stiffness=100.0, pins=())
    linear = cs.Scene(tiny, gravity=NO_GRAVITY, position=random_displacements(tiny, 1.0))
    scene = near_cloth_scene()
    cloth = scene.cloth
    coincident = cloth.rest_positions.copy()
    coincident[3, 3] = coincident[3, 4]
    one_place = np.full((8, 8, 3), 0.25)
    undamped = half_kilogram_cloth(stiffness=1000.0, pins=())
    noisy = cs.Scene(
        undamped, gravity=NO_GRAVITY, position=one_place + random_displacements(undamped, 1e-9)
    )
    half = 0.5 * cs.max_stable_dt(cs.Scene(cloth))
    sphere = scene.spheres[0]
    center = np.add(sphere.center, FAR)
    cases = {
        "zero rest length": HardCase(
            linear,
            dt=0.02 * cs.max_stable_dt(linear),
            steps=5000,
            why="springs of 1e-300 m are linear in every direction, also through zero length",
        ),
        "coincident points": HardCase(
            cs.Scene(cloth, position=coincident),
            dt=half,
            steps=500,
            why="a spring without length has no direction",
        ),
        "collapsed cloth": HardCase(
            cs.Scene(cloth.replace(pins=()), position=one_place),
            dt=1e-3,
            steps=1000,
            why="all points in one place: no spring has a direction",
        ),
        "collapsed cloth with two pins": HardCase(
            cs.Scene(cloth, position=one_place),
            dt=half,
            steps=2000,
            why="the fall parts points by rounding alone, and the springs drive them on",
        ),
        "collapsed cloth with noise": HardCase(
            noisy,
            dt=0.005 * cs.max_stable_dt(noisy),
            steps=8000,
            why="points 1e-9 m apart whose springs want 0.14 m: directions turn in no time",
        ),
        "1e6 m away": HardCase(
            scene.replace(
                spheres=sphere.replace(center=center), position=cloth.rest_positions + FAR
            ),
            dt=5e-4,
            steps=1000,
            why="float32 tells points there apart by 6 cm",
        ),
    }
    for shape in ((1, 2), (1, 12), (12, 1), (2, 12)):
        scene = cs.Scene(half_kilogram_cloth(shape, stiffness=1000.0, damping=1.0, pins=[(0, 0)]))
        cases["a strip of {} x {}".format(*shape)] = HardCase(
            scene,
            dt=0.5 * cs.max_stable_dt(scene),
            steps=400,
            why="no cell, or one row of them; families without a spring",
        )
    return cases


def contact_cases() -> dict[str, HardCase]:
    """Make cases of points and pins that start inside a sphere, and of a sphere that is faster than
    the test.
    """
    soft = half_kilogram_cloth(stiffness=1000.0, damping=1.0)
    loose = half_kilogram_cloth((2, 2), stiffness=0.0, pins=())
    inside = loose.rest_positions + 10.0
    inside[0, 0] = (0.03, -0.04, 0.12)
    centre = loose.rest_positions + 10.0
    centre[0, 0] = (0.0, 0.0, 0.0)
    unit = cs.Sphere((0.0, 0.0, 0.0), 0.5, offset="none", response="ray")
    at_pin = cs.Sphere((0.0, 0.0, 0.0), 0.3, offset="none", restitution=0.5, response="ray")
    in_sheet = cs.Sphere((0.5, 0.0, 0.5), 0.25, offset="none", restitution=0.5, response="ray")
    fast = cs.Sphere(
        (0.5, -2.0, 0.5), 0.25, cs.Linear((0.0, 100.0, 0.0)), offset="none", response="ray"
    )
    settled = 0.2 * cs.max_stable_dt(cs.Scene(soft))
    return {
        "pins inside a sphere": HardCase(
            cs.Scene(soft, at_pin),
            dt=settled,
            steps=1000,
            why="what holds the cloth may not move, what hangs on it may not stay",
        ),
        "a sphere that starts inside the cloth": HardCase(
            cs.Scene(soft, in_sheet),
            dt=settled,
            steps=1000,
            why="points inside at rest have no ray to go back along",
        ),
        "a point at rest inside": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=inside),
            dt=1e-3,
            steps=1,
            why="no velocity, so no ray",
        ),
        "a point at the exact centre": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=centre),
            dt=1e-3,
            steps=1,
            why="no velocity and no normal",
        ),
        "a sphere at 100 m/s": HardCase(
            cs.Scene(soft, fast, NO_GRAVITY),
            dt=1e-4,
            steps=180,
            why="it moves by 1 cm a step and is through the sheet in 50",
        ),
    }


def hard_cases() -> dict[str, HardCase]:
    """Make the scenes that are difficult for the method or the arithmetic, by name.

    Returns
    -------
    dict of str to clothsim.hard_cases.HardCase
        A case has `scene`, `dt`, `steps`, `precisions`, `why` (a text that explains the difficulty)
        and `unstable` (whether an `UnstableError` is the right outcome).

    Examples
    --------
    >>> case = cs.scenes.hard_cases()["1e6 m away"]
    >>> case.why
    'float32 tells points there apart by 6 cm'
    >>> run = cs.simulate(case.scene, case.steps * case.dt, case.dt, precision="single")
    >>> run.report["steps"] == case.steps
    True
    """
    families = (stiffness_cases, time_step_cases, geometry_cases, mass_cases, contact_cases)
    return {name: case for family in families for name, case in family().items()}
