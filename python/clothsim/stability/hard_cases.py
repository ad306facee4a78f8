"""The hard cases, family by family; `clothsim.scenes.hard_cases` names them all.

Bounds are some five to twenty times what is measured: see docs/stability.md for the figures.
"""

from __future__ import annotations

import numpy as np

from ..cloth import Cloth
from ..measures import max_stable_dt
from ..motion import Linear
from ..scene import Scene
from ..sphere import Sphere
from ..stepping import step
from .hard_case import (
    End,
    Figure,
    Floats,
    HardCase,
    blows_up,
    ends_at,
    gains_energy,
    moves_like_the_reference,
)
from .spectrum import spectral_limit

_NO_GRAVITY = (0.0, 0.0, 0.0)


def _cloth(shape: tuple[int, int] = (8, 8), **changes: object) -> Cloth:
    """Half a kilogram a point, undamped, pinned at two corners, unless `changes` say otherwise."""
    mass = 0.5 * shape[0] * shape[1]
    return Cloth(**{"shape": shape, "mass": mass, "damping": 0.0, **changes})


def _noise(cloth: Cloth, size: float) -> Floats:
    noise = np.random.default_rng(0).normal(scale=size, size=(*cloth.shape, 3))
    return noise * ~cloth.pinned[..., None]


def stiffness() -> dict[str, HardCase]:
    """Springs of 1e6 to 1e12 N/m, and of 1e7 beside 1 N/m."""
    cases = {}
    for k, double, single in ((1e6, 3e-13, 1e-4), (1e9, 3e-11, 1e-2), (1e12, 1e-11, 1e-2)):
        cloth = _cloth(stiffness=k, damping=1e-3 * k**0.5)
        scene = Scene(cloth, position=cloth.rest_positions + _noise(cloth, 1e-3))
        cases[f"stiffness {k:.0e} N/m".replace("e+", "e")] = HardCase(
            scene, 0.9 * max_stable_dt(scene), 1000,
            "waves of a thousand to a million Hz beside gravity",
            "the reference's motion; damping takes energy out",
            (moves_like_the_reference(double, single), gains_energy(0.0, 0.0)),
        )  # fmt: skip
    for strong in ("structural", "shear"):
        families = {f: 1e7 if f == strong else 1.0 for f in ("structural", "shear", "bend")}
        scene = Scene(_cloth(stiffness=families))
        cases[f"{strong} springs of 1e7 beside 1 N/m"] = HardCase(
            scene, 0.9 * max_stable_dt(scene), 2000,
            "one family is 10 million times stiffer than the others",
            "the reference's motion; energy is kept",
            (moves_like_the_reference(1e-13, 1e-5), gains_energy(1e-7, 1e-5, 1e-5)),
        )  # fmt: skip
    return cases


def time_steps() -> dict[str, HardCase]:
    """Right below and right above the limit, very small steps, very many steps."""
    cloth = _cloth(stiffness=900.0)
    scene = Scene(cloth, gravity=_NO_GRAVITY, velocity=_noise(cloth, 1e-5))
    rest = cloth.rest_positions
    limit = spectral_limit("rk4", scene, rest, np.zeros_like(rest))
    return {
        "dt at 0.95 of the limit": HardCase(
            scene, 0.95 * limit, 4000,
            "every wave turns by almost half a turn a step",
            "no energy gained",
            (gains_energy(1e-12, 1e-5),),
        ),
        "dt at 1.05 of the limit": HardCase(
            scene, 1.05 * limit, 4000,
            "the fastest wave grows by two fifths a step",
            "UnstableError while the cloth still has its size",
            (blows_up(within=300),),
            unstable=True,
        ),
        "dt 5e-6 s in single": HardCase(
            Scene(_cloth((12, 12), damping=100.0)), 5e-6, 50_000,
            "a step moves a point by less than float32 can tell",
            "the motion in double, to 1e-7 m after 0.25 s",
            (_ends_like_double(1e-7),),
            precisions=("single",),
        ),
        "a million steps": HardCase(
            drum((4, 4), damping=0.0), 5e-6, 1_000_000,
            "rounding adds up",
            "energy is kept",
            (gains_energy(1e-11, 2e-5, 2e-5),),
        ),
        "a million steps in single": HardCase(
            drum((4, 4)), 5e-6, 1_000_000,
            "rounding adds up, in float32 at steps that float32 alone could not take",
            "the motion in double, to 2e-7 m after 5 s",
            (_ends_like_double(2e-7),),
            precisions=("single",),
        ),
    }  # fmt: skip


def drum(shape: tuple[int, int], damping: float = 100.0) -> Scene:
    """The paper's springs and masses, stretched by a tenth, clamped all round and let go.

    It swings in gravity without folding, so that rounding is not amplified: two computations of it
    can be compared after any time.
    """
    clamped = np.ones(shape, bool)
    clamped[1:-1, 1:-1] = False
    cloth = _cloth(shape, pins=clamped, damping=damping)
    return Scene(cloth, position=1.1 * cloth.rest_positions)


def _ends_like_double(bound: float):
    def judge(case: HardCase, end: End) -> list[Figure]:
        start = case.scene.initial_position, case.scene.initial_velocity
        other = "double" if end.precision == "single" else "single"
        expected, _ = step(
            case.scene, *start, case.dt, case.steps, precision=other, threads=1,
            kernel=end.stepper.kernel,
        )  # fmt: skip
        error = float(np.linalg.norm(end.x - expected, axis=-1).max())
        return [Figure("m between single and double", error, 0, bound)]

    return judge


def geometry() -> dict[str, HardCase]:
    """Points that coincide, springs without length, narrow cloths, far places."""
    linear = _cloth(size=(1e-300, 1e-300), stiffness=100.0, pins=())
    linear = Scene(linear, gravity=_NO_GRAVITY, position=_noise(linear, 1.0))
    cloth = _cloth(stiffness=1000.0, damping=1.0)
    coincident = cloth.rest_positions.copy()
    coincident[3, 3] = coincident[3, 4]
    at_once = np.full((8, 8, 3), 0.25)
    free = cloth.replace(pins=())
    undamped = _cloth(stiffness=1000.0, pins=())
    noisy = Scene(undamped, gravity=_NO_GRAVITY, position=at_once + _noise(undamped, 1e-9))
    collapsed = Scene(cloth, position=at_once)
    fine = 0.005 * max_stable_dt(noisy)
    half = 0.5 * max_stable_dt(Scene(cloth))
    here = Scene(cloth, Sphere((0.5, -0.4, 0.5), 0.25, offset="none"))
    far = np.array([1e6, 1e6, 1e6])
    there = Scene(
        cloth, Sphere(tuple(far + here.spheres[0].center), 0.25, offset="none"),
        position=cloth.rest_positions + far,
    )  # fmt: skip
    cases = {
        "zero rest length": HardCase(
            linear, 0.02 * max_stable_dt(linear), 5000,
            "springs of 1e-300 m are linear in every direction, also through zero length",
            "the sum of the sheet's normal modes",
            (ends_at(_normal_modes, "m from the normal modes", 1e-4, 1e-4),
             moves_like_the_reference(1e-11, 1e-3)),
        ),
        "coincident points": HardCase(
            Scene(cloth, position=coincident), half, 500,
            "a spring without length has no direction",
            "it exerts no force until its ends part: the reference's motion",
            (moves_like_the_reference(1e-11, 1e-3), gains_energy(0.0, 0.0)),
        ),
        "collapsed cloth": HardCase(
            Scene(free, position=at_once), 1e-3, 1000,
            "all points in one place: no spring has a direction",
            "it falls like one point",
            (ends_at(_fallen, "m from free fall", 1e-12, 1e-6),),
        ),
        "collapsed cloth with two pins": HardCase(
            collapsed, half, 2000,
            "the fall parts points by rounding alone, and the springs drive them on",
            "any motion that gains no energy",
            (gains_energy(0.0, 0.0),),
        ),
        "collapsed cloth with noise": HardCase(
            noisy, fine, 8000,
            "points 1e-9 m apart whose springs want 0.14 m: directions turn in no time",
            "an explosion that keeps its energy to 3e-5",
            (gains_energy(3e-5, 3e-5, 3e-5),),
        ),
        "1e6 m away": HardCase(
            there, 5e-4, 1000,
            "float32 tells points there apart by 6 cm",
            "the motion at the origin, contact included",
            (ends_at(lambda case: _moved(here, case, far), "m from the motion here", 5e-8, 5e-6),),
        ),
    }  # fmt: skip
    for shape in ((1, 2), (1, 12), (12, 1), (2, 12)):
        scene = Scene(_cloth(shape, stiffness=1000.0, damping=1.0, pins=[(0, 0)]))
        cases["a strip of {} x {}".format(*shape)] = HardCase(
            scene, 0.5 * max_stable_dt(scene), 400,
            "no cell, or one row of them; families without a spring",
            "the reference's motion",
            (moves_like_the_reference(5e-12, 5e-4),),
        )  # fmt: skip
    return cases


def _fallen(case: HardCase) -> Floats:
    t = case.steps * case.dt
    return case.scene.initial_position + np.array(case.scene.gravity) * t * t / 2


def _moved(here: Scene, case: HardCase, by: Floats) -> Floats:
    return step(here, here.initial_position, here.initial_velocity, case.dt, case.steps)[0] + by


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
    return (modes @ (phase[:, None] * (modes.T @ start))).reshape(*cloth.shape, 3)


def masses_and_speeds() -> dict[str, HardCase]:
    """One light or heavy point, and speeds that are denormal numbers."""
    cases = {}
    for name, ratio in (("lighter", 1e-6), ("heavier", 1e6)):
        mass = np.ones((8, 8))
        mass[3, 4] = ratio
        scene = Scene(_cloth(mass=mass, stiffness=1000.0))
        cases[f"a point 1e6 times {name}"] = HardCase(
            scene, 0.9 * max_stable_dt(scene), 2000,
            "one point is a thousand times faster or slower than the others",
            "the reference's motion; energy is kept",
            (moves_like_the_reference(2e-13, 1e-4), gains_energy(1e-12, 1e-6, 1e-7)),
        )  # fmt: skip
    for precision, speed in (("double", 1e-310), ("single", 1e-40)):
        cloth = _cloth((4, 4), stiffness=0.0, pins=())
        scene = Scene(
            cloth, gravity=_NO_GRAVITY, position=np.zeros((4, 4, 3)),
            velocity=np.full((4, 4, 3), speed),
        )  # fmt: skip
        cases[f"denormal speeds in {precision}"] = HardCase(
            scene, 1e-3, 1000,
            "numbers below the smallest with full precision, which some settings round to zero",
            "speed times time, to 1 %",
            (_drifts(speed),),
            precisions=(precision,),
        )  # fmt: skip
    return cases


def _drifts(speed: float):
    def judge(case: HardCase, end: End) -> list[Figure]:
        way = speed * case.steps * case.dt
        return [
            Figure("speed / given", float(end.v.min() / speed), 0.999, 1.001),
            Figure("way / (speed x time)", float(end.x.min() / way), 0.99, 1.01),
        ]

    return judge


def contact() -> dict[str, HardCase]:
    """Points and pins inside a sphere from the start, and a sphere that is faster than the test."""
    soft = _cloth(stiffness=1000.0, damping=1.0)
    loose = _cloth((2, 2), stiffness=0.0, pins=())
    inside, centre = loose.rest_positions + 10.0, loose.rest_positions + 10.0
    inside[0, 0], centre[0, 0] = (0.03, -0.04, 0.12), (0.0, 0.0, 0.0)
    unit = Sphere((0.0, 0.0, 0.0), 0.5, offset="none")
    at_pin = Sphere((0.0, 0.0, 0.0), 0.3, offset="none", restitution=0.5)
    in_sheet = Sphere((0.5, 0.0, 0.5), 0.25, offset="none", restitution=0.5)
    fast = Sphere((0.5, -2.0, 0.5), 0.25, Linear((0.0, 100.0, 0.0)), offset="none")
    settled = 0.2 * max_stable_dt(Scene(soft))
    return {
        "pins inside a sphere": HardCase(
            Scene(soft, at_pin), settled, 1000,
            "what holds the cloth may not move, what hangs on it may not stay",
            "pins stay to the last bit; free points leave the sphere",
            (_pins_stay, _free_points_out(1e-12)),
        ),
        "a sphere that starts inside the cloth": HardCase(
            Scene(soft, in_sheet), settled, 1000,
            "points inside at rest have no ray to go back along",
            "free points leave the sphere, at less than 10 m/s",
            (_free_points_out(1e-12), _speeds(0.0, 10.0)),
        ),
        "a point at rest inside": HardCase(
            Scene(loose, unit, _NO_GRAVITY, position=inside), 1e-3, 1,
            "no velocity, so no ray",
            "it is moved out along the normal",
            (ends_at(lambda case: _only(case, (3 / 26, -4 / 26, 12 / 26)),
                     "m from the foot of the normal", 1e-15, 1e-7),),
        ),
        "a point at the exact centre": HardCase(
            Scene(loose, unit, _NO_GRAVITY, position=centre), 1e-3, 1,
            "no velocity and no normal",
            "it leaves upwards, the documented direction",
            (ends_at(lambda case: _only(case, (0.0, 0.5, 0.0)), "m from above the centre",
                     1e-12, 1e-7),),
        ),
        "a sphere at 100 m/s": HardCase(
            Scene(soft, fast, _NO_GRAVITY), 1e-4, 180,
            "it moves by 1 cm a step and is through the sheet in 50",
            "the reference's motion; points leave at up to twice its speed, none is left inside",
            (moves_like_the_reference(1e-13, 1e-5), _speeds(150.0, 201.0), _free_points_out(0.0)),
        ),
    }  # fmt: skip


def _only(case: HardCase, place: tuple[float, float, float]) -> Floats:
    expected = case.scene.initial_position.copy()
    expected[0, 0] = place
    return expected


def _pins_stay(case: HardCase, end: End) -> list[Figure]:
    pinned = case.scene.cloth.pinned
    moved = np.abs(end.x - case.scene.initial_position)[pinned].max()
    return [Figure("m that pins moved", float(moved), 0, 0)]


def _free_points_out(depth: float):
    def judge(case: HardCase, end: End) -> list[Figure]:
        (sphere,) = case.scene.spheres
        free = end.x[~case.scene.cloth.pinned]
        distance = np.linalg.norm(free - sphere.center_at(case.steps * case.dt), axis=-1).min()
        return [Figure("m inside", float(max(0.0, sphere.radius - distance)), 0, depth)]

    return judge


def _speeds(least: float, most: float):
    def judge(case: HardCase, end: End) -> list[Figure]:
        fastest = float(np.linalg.norm(end.v, axis=-1).max())
        return [Figure("fastest point [m/s]", fastest, least, most)]

    return judge


def hard_cases() -> dict[str, HardCase]:
    """All of them by name."""
    families = (stiffness, time_steps, geometry, masses_and_speeds, contact)
    return {name: case for family in families for name, case in family().items()}
