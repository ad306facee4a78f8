"""Hard cases of contact."""

from __future__ import annotations

import numpy as np

import clothsim as cs

from .case import NO_GRAVITY, End, Figure, Floats, HardCase, Judge, ends_at, moves_like_the_reference, sheet


def contact() -> dict[str, HardCase]:
    """Points and pins inside a sphere from the start, and a sphere that is faster than the test."""
    soft = sheet(stiffness=1000.0, damping=1.0)
    loose = sheet((2, 2), stiffness=0.0, pins=())
    inside, centre = loose.rest_positions + 10.0, loose.rest_positions + 10.0
    inside[0, 0], centre[0, 0] = (0.03, -0.04, 0.12), (0.0, 0.0, 0.0)
    unit = cs.Sphere((0.0, 0.0, 0.0), 0.5, offset="none", response="ray")
    at_pin = cs.Sphere((0.0, 0.0, 0.0), 0.3, offset="none", restitution=0.5, response="ray")
    in_sheet = cs.Sphere((0.5, 0.0, 0.5), 0.25, offset="none", restitution=0.5, response="ray")
    fast = cs.Sphere((0.5, -2.0, 0.5), 0.25, cs.Linear((0.0, 100.0, 0.0)), offset="none", response="ray")
    settled = 0.2 * cs.max_stable_dt(cs.Scene(soft))
    return {
        "pins inside a sphere": HardCase(
            cs.Scene(soft, at_pin),
            settled,
            1000,
            "what holds the cloth may not move, what hangs on it may not stay",
            "pins stay to the last bit; free points leave the sphere",
            (_pins_stay, _free_points_out(1e-12)),
        ),
        "a sphere that starts inside the cloth": HardCase(
            cs.Scene(soft, in_sheet),
            settled,
            1000,
            "points inside at rest have no ray to go back along",
            "free points leave the sphere, at less than 10 m/s",
            (_free_points_out(1e-12), _speeds(0.0, 10.0)),
        ),
        "a point at rest inside": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=inside),
            1e-3,
            1,
            "no velocity, so no ray",
            "it is moved out along the normal",
            (ends_at(lambda case: _only(case, (3 / 26, -4 / 26, 12 / 26)), "m from the foot of the normal", 1e-15, 1e-7),),
        ),
        "a point at the exact centre": HardCase(
            cs.Scene(loose, unit, NO_GRAVITY, position=centre),
            1e-3,
            1,
            "no velocity and no normal",
            "it leaves upwards, the documented direction",
            (ends_at(lambda case: _only(case, (0.0, 0.5, 0.0)), "m from above the centre", 1e-12, 1e-7),),
        ),
        "a sphere at 100 m/s": HardCase(
            cs.Scene(soft, fast, NO_GRAVITY),
            1e-4,
            180,
            "it moves by 1 cm a step and is through the sheet in 50",
            "the reference's motion; points leave at up to twice its speed, none is left inside",
            (moves_like_the_reference(1e-13, 1e-5), _speeds(150.0, 201.0), _free_points_out(0.0)),
        ),
    }


def _only(case: HardCase, place: tuple[float, float, float]) -> Floats:
    expected = case.scene.initial_position.copy()
    expected[0, 0] = place
    return expected


def _pins_stay(case: HardCase, end: End) -> list[Figure]:
    pinned = case.scene.cloth.pinned
    moved = np.abs(end.x - case.scene.initial_position)[pinned].max()
    return [Figure("m that pins moved", float(moved), 0, 0)]


def _free_points_out(depth: float) -> Judge:
    def judge(case: HardCase, end: End) -> list[Figure]:
        (sphere,) = case.scene.spheres
        free = end.x[~case.scene.cloth.pinned]
        distance = np.linalg.norm(free - sphere.center_at(case.steps * case.dt), axis=-1).min()
        return [Figure("m inside", float(max(0.0, sphere.radius - distance)), 0, depth)]

    return judge


def _speeds(least: float, most: float) -> Judge:
    def judge(case: HardCase, end: End) -> list[Figure]:
        fastest = float(np.linalg.norm(end.v, axis=-1).max())
        return [Figure("fastest point [m/s]", fastest, least, most)]

    return judge
