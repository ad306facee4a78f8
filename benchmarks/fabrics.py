"""Stable steps of published fabrics, and seconds of computing for a simulated second.

Usage: python benchmarks/fabrics.py [--steps 2000]

A square metre, held by two corners, swings down by RK4 at nine tenths of its guaranteed step, on
all threads. The time is that of the first 0.5 s of the motion, or of the first --steps steps where
they are fewer, for a second. The error, at 32 points a side, is the rms distance after 0.5 s from a
run with half the step. docs/runs.md has the sources of the figures.
"""

import argparse
from time import perf_counter

import clothsim as cs
from common import conditions

DURATION = 0.5  # s
POINTS = (32, 100, 300)  # of a side
LOSSES = (0.0, 1e-3)  # damping over stiffness, s
FABRICS = {  # kg/m2; tensile stiffness Y and shear stiffness G, N/m
    "interlock knit": (0.187, 51.1, 18.4),
    "rib knit": (0.276, 108.0, 41.6),
    "cotton": (0.150, 261.0, 105.0),
    "denim": (0.324, 1219.0, 26.7),
    "polyester": (0.128, 4030.0, 9.6),
    "denim, tensile test": (0.324, 15_000.0, 26.7),
}


def scene(density, tensile, shear, loss, points):
    stiffness = {"structural": tensile - shear, "shear": shear}
    damping = {family: loss * value for family, value in stiffness.items()}
    return cs.Scene(
        cs.Cloth(
            (points, points),
            mass=density,
            stiffness=stiffness,
            damping=damping,
            springs=("structural", "shear"),
        )
    )


def seconds(fabric, dt, limit):
    """Return seconds of computing for a simulated second."""
    steps = min(limit, round(DURATION / dt))
    stepper = cs.Stepper(fabric)
    stepper.advance(100, dt)
    begin = perf_counter()
    stepper.advance(steps, dt)
    return (perf_counter() - begin) / (steps * dt)


def error(fabric, dt):
    """Return the rms distance from a run with half the step [m]."""
    coarse, fine = (cs.simulate(fabric, DURATION, dt=h) for h in (dt, dt / 2))
    return cs.difference(coarse, fine)["rms"][-1]


def short(value):
    """Return two digits, with thousands apart and a short exponent."""
    text = f"{value:.1e}" if value < 1e-3 else f"{float(f'{value:.2g}'):,g}"
    return text.replace("e-0", "e-")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=2000, help="timed, at most (default 2000)")
    args = parser.parse_args()
    head = [f"{points} points" for points in POINTS]
    print(f"| fabric | c/K [s] | {' | '.join(head)} | error at 32 |\n|" + " --- |" * 6)
    for name, figures in FABRICS.items():
        for loss in LOSSES:
            cells = []
            for points in POINTS:
                fabric = scene(*figures, loss, points)
                limit = cs.max_stable_dt(fabric)
                cost = min(seconds(fabric, 0.9 * limit, args.steps) for _ in range(3))
                cells.append(f"{short(limit)} s; {short(cost)} s")
            small = scene(*figures, loss, POINTS[0])
            cells.append(f"{short(error(small, 0.9 * cs.max_stable_dt(small)))} m")
            print(f"| {name} | {loss:g} | {' | '.join(cells)} |", flush=True)
    print(f"\n{conditions()}")


if __name__ == "__main__":
    main()
