"""Hard cases of geometry: coincident points, springs without length, strips, far places."""

from __future__ import annotations

import numpy as np

import clothsim as cs

from .case import NO_GRAVITY, Floats, HardCase, ends_at, gains_energy, moves_like_the_reference, noise, sheet


def geometry() -> dict[str, HardCase]:
    """Points that coincide, springs without length, narrow cloths, far places."""
    tiny = sheet(size=(1e-300, 1e-300), stiffness=100.0, pins=())
    linear = cs.Scene(tiny, gravity=NO_GRAVITY, position=noise(tiny, 1.0))
    cloth = sheet(stiffness=1000.0, damping=1.0)
    coincident = cloth.rest_positions.copy()
    coincident[3, 3] = coincident[3, 4]
    at_once = np.full((8, 8, 3), 0.25)
    free = cloth.replace(pins=())
    undamped = sheet(stiffness=1000.0, pins=())
    noisy = cs.Scene(undamped, gravity=NO_GRAVITY, position=at_once + noise(undamped, 1e-9))
    collapsed = cs.Scene(cloth, position=at_once)
    fine = 0.005 * cs.max_stable_dt(noisy)
    half = 0.5 * cs.max_stable_dt(cs.Scene(cloth))
    here = cs.Scene(cloth, cs.Sphere((0.5, -0.4, 0.5), 0.25, offset="none", response="ray"))
    far = np.array([1e6, 1e6, 1e6])
    there = cs.Scene(
        cloth,
        cs.Sphere(tuple(far + here.spheres[0].center), 0.25, offset="none", response="ray"),
        position=cloth.rest_positions + far,
    )
    return {
        "zero rest length": HardCase(
            linear,
            0.02 * cs.max_stable_dt(linear),
            5000,
            "springs of 1e-300 m are linear in every direction, also through zero length",
            "the sum of the sheet's normal modes",
            (ends_at(_normal_modes, "m from the normal modes", 1e-4, 1e-4), moves_like_the_reference(1e-11, 1e-3)),
        ),
        "coincident points": HardCase(
            cs.Scene(cloth, position=coincident),
            half,
            500,
            "a spring without length has no direction",
            "it exerts no force until its ends part: the reference's motion",
            (moves_like_the_reference(1e-11, 1e-3), gains_energy(0.0, 0.0)),
        ),
        "collapsed cloth": HardCase(
            cs.Scene(free, position=at_once),
            1e-3,
            1000,
            "all points in one place: no spring has a direction",
            "it falls like one point",
            (ends_at(_fallen, "m from free fall", 1e-12, 1e-6),),
        ),
        "collapsed cloth with two pins": HardCase(
            collapsed,
            half,
            2000,
            "the fall parts points by rounding alone, and the springs drive them on",
            "any motion that gains no energy",
            (gains_energy(0.0, 0.0),),
        ),
        "collapsed cloth with noise": HardCase(
            noisy,
            fine,
            8000,
            "points 1e-9 m apart whose springs want 0.14 m: directions turn in no time",
            "an explosion that keeps its energy to 3e-5",
            (gains_energy(3e-5, 3e-5, 3e-5),),
        ),
        "1e6 m away": HardCase(
            there,
            5e-4,
            1000,
            "float32 tells points there apart by 6 cm",
            "the motion at the origin, contact included",
            (ends_at(lambda case: _moved(here, case, far), "m from the motion here", 5e-8, 5e-6),),
        ),
        **_strips(),
    }


def _strips() -> dict[str, HardCase]:
    cases = {}
    for shape in ((1, 2), (1, 12), (12, 1), (2, 12)):
        scene = cs.Scene(sheet(shape, stiffness=1000.0, damping=1.0, pins=[(0, 0)]))
        cases["a strip of {} x {}".format(*shape)] = HardCase(
            scene,
            0.5 * cs.max_stable_dt(scene),
            400,
            "no cell, or one row of them; families without a spring",
            "the reference's motion",
            (moves_like_the_reference(5e-12, 5e-4),),
        )
    return cases


def _fallen(case: HardCase) -> Floats:
    t = case.steps * case.dt
    return case.scene.initial_position + np.array(case.scene.gravity) * t * t / 2


def _moved(here: cs.Scene, case: HardCase, by: Floats) -> Floats:
    start = here.initial_position, here.initial_velocity
    return cs.step(here, *start, case.dt, case.steps, t=0.0)[0] + by


def _normal_modes(case: HardCase) -> Floats:
    """x(t) = cos(sqrt(L) t) x(0), L the spring Laplacian per unit mass."""
    cloth = case.scene.cloth
    table = cloth.spring_table()
    laplacian = np.zeros((cloth.rows * cloth.columns,) * 2)
    for a, b, sign in (("i", "i", 1), ("j", "j", 1), ("i", "j", -1), ("j", "i", -1)):
        np.add.at(laplacian, (table[a], table[b]), sign * table["stiffness"])
    squares, modes = np.linalg.eigh(laplacian / cloth.mass_per_point[0, 0])
    phase = np.cos(np.sqrt(squares.clip(0)) * case.steps * case.dt)
    start = case.scene.initial_position.reshape(-1, 3)
    return np.reshape(modes @ (phase[:, None] * (modes.T @ start)), (*cloth.shape, 3))
