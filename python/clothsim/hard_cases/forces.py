"""Hard cases of stiffness, time step and mass.

Bounds are about five to twenty times the measured figures, which docs/stability.md lists.
"""

from __future__ import annotations

import numpy as np

import clothsim as cs
from clothsim.typing import Precision

from .case import NO_GRAVITY, End, Figure, HardCase, Judge, blows_up, gains_energy, moves_like_the_reference, noise, sheet


def stiffness() -> dict[str, HardCase]:
    """Springs of 1e6 to 1e12 N/m, and of 1e7 beside 1 N/m."""
    cases = {}
    for k, double, single in ((1e6, 3e-13, 1e-4), (1e9, 3e-11, 1e-2), (1e12, 1e-11, 1e-2)):
        cloth = sheet(stiffness=k, damping=1e-3 * k**0.5)
        scene = cs.Scene(cloth, position=cloth.rest_positions + noise(cloth, 1e-3))
        cases[f"stiffness {k:.0e} N/m".replace("e+", "e")] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            1000,
            "waves of a thousand to a million Hz beside gravity",
            "the reference's motion; damping takes energy out",
            (moves_like_the_reference(double, single), gains_energy(0.0, 0.0)),
        )
    for strong in ("structural", "shear"):
        families = {f: 1e7 if f == strong else 1.0 for f in ("structural", "shear", "bend")}
        scene = cs.Scene(sheet(stiffness=families))
        cases[f"{strong} springs of 1e7 beside 1 N/m"] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            2000,
            "one family is 10 million times stiffer than the others",
            "the reference's motion; energy is kept",
            (moves_like_the_reference(1e-13, 1e-5), gains_energy(1e-7, 1e-5, 1e-5)),
        )
    return cases


def time_steps() -> dict[str, HardCase]:
    """Right below and right above the limit, very small steps, very many steps."""
    cloth = sheet(stiffness=900.0)
    scene = cs.Scene(cloth, gravity=NO_GRAVITY, velocity=noise(cloth, 1e-5))
    limit = cs.max_stable_dt(scene, x=cloth.rest_positions) / 0.97  # which is 3 % below the limit
    return {
        "dt at 0.95 of the limit": HardCase(
            scene,
            0.95 * limit,
            4000,
            "every wave turns by almost half a turn a step",
            "no energy gained",
            (gains_energy(1e-12, 1e-5),),
        ),
        "dt at 1.05 of the limit": HardCase(
            scene,
            1.05 * limit,
            4000,
            "the fastest wave grows by two fifths a step",
            "UnstableError while the cloth still has its size",
            (blows_up(within=300),),
            unstable=True,
        ),
        "dt 5e-6 s in single": HardCase(
            cs.Scene(sheet((12, 12), damping=100.0)),
            5e-6,
            50_000,
            "a step moves a point by less than float32 can tell",
            "the motion in double, to 1e-7 m after 0.25 s",
            (_ends_like_double(1e-7),),
            precisions=("single",),
        ),
        "a million steps": HardCase(
            drum((4, 4), damping=0.0),
            5e-6,
            1_000_000,
            "rounding adds up",
            "energy is kept",
            (gains_energy(1e-11, 2e-5, 2e-5),),
        ),
        "a million steps in single": HardCase(
            drum((4, 4)),
            5e-6,
            1_000_000,
            "rounding adds up, in float32 at steps that float32 alone could not take",
            "the motion in double, to 2e-7 m after 5 s",
            (_ends_like_double(2e-7),),
            precisions=("single",),
        ),
    }


def drum(shape: tuple[int, int], damping: float = 100.0) -> cs.Scene:
    """A cloth with the paper's springs and masses, stretched by a tenth and pinned along its border.

    It swings in gravity without folding, so that rounding is not amplified: two computations of it
    can be compared after any time.
    """
    clamped = np.ones(shape, bool)
    clamped[1:-1, 1:-1] = False
    cloth = sheet(shape, pins=clamped, damping=damping)
    return cs.Scene(cloth, position=1.1 * cloth.rest_positions)


def _ends_like_double(bound: float) -> Judge:
    def judge(case: HardCase, end: End) -> list[Figure]:
        start = case.scene.initial_position, case.scene.initial_velocity
        other: Precision = "double" if end.precision == "single" else "single"
        expected, _ = cs.step(
            case.scene, *start, case.dt, case.steps, t=0.0, precision=other, threads=1, kernel=end.stepper.kernel
        )
        error = float(np.linalg.norm(end.x - expected, axis=-1).max())
        return [Figure("m between single and double", error, 0, bound)]

    return judge


def masses() -> dict[str, HardCase]:
    """One light or heavy point."""
    cases = {}
    for name, ratio in (("lighter", 1e-6), ("heavier", 1e6)):
        mass = np.ones((8, 8))
        mass[3, 4] = ratio
        scene = cs.Scene(sheet(mass=mass, stiffness=1000.0))
        cases[f"a point 1e6 times {name}"] = HardCase(
            scene,
            0.9 * cs.max_stable_dt(scene),
            2000,
            "one point is a thousand times faster or slower than the others",
            "the reference's motion; energy is kept",
            (moves_like_the_reference(2e-13, 1e-4), gains_energy(1e-12, 1e-6, 1e-7)),
        )
    return cases
