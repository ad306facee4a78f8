"""Time per step with a force of time and state, and with wind.

Usage: python benchmarks/forces.py [--windows 300] [--steps 20]

The cloth is that of paper_swing, 32 x 32 mass points, on one thread. Times are microseconds per
step, the least of many short windows; the cells of a method take turns. In parentheses is the ratio
to a step of the same method without a force, of rk4 that of the fused kernel.
"""

import argparse

import clothsim as cs
import numba
from clothsim.scenes import PAPER_DT
from common import conditions
from timing import Steps, measure

METHODS = ("rk4", "velocity_verlet", "dopri5")
PRECISIONS = ("double", "single")
_POINTER = numba.types.CPointer(numba.types.double)
_SIGNATURE = numba.types.void(numba.types.double, _POINTER, _POINTER, _POINTER, numba.types.int64)


@numba.cfunc(_SIGNATURE)
def empty(t, x, v, f, points):
    pass


@numba.cfunc(_SIGNATURE)
def damping(t, x, v, f, points):
    for k in range(3 * points):
        f[k] = -0.01 * v[k]


def damping_of_numpy(t, x, v):
    return -0.01 * v


SCENE = cs.scenes.paper_swing()
ROWS = {
    "none": (SCENE, None),
    "C function that writes nothing": (SCENE, empty),
    "C function, `-0.01 * v`": (SCENE, damping),
    "Python function, `-0.01 * v`": (SCENE, damping_of_numpy),
    "wind": (SCENE.replace(wind=cs.Wind((5.0, 0.0, 1.0))), None),
}


def time_method(method, windows, steps):
    """Return microseconds per step of each row, in both precisions."""
    works = [
        Steps(
            cs.Stepper(scene, integrator=method, precision=precision, threads=1, force=force),
            PAPER_DT,
            steps,
        )
        for precision in PRECISIONS
        for scene, force in ROWS.values()
    ]
    times = [1e6 * timing.minimum for timing in measure(works, windows)]
    return times[: len(ROWS)], times[len(ROWS) :]


def cell(time, without):
    return f"{time:.1f}" if time == without else f"{time:.0f} ({time / without:.1f})"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--windows", type=int, default=300, help="of each row (default 300)")
    parser.add_argument("--steps", type=int, default=20, help="of a window (default 20)")
    args = parser.parse_args()
    columns = [time_method(method, args.windows, args.steps) for method in METHODS]
    head = [f"`{method}`, {precision}" for method in METHODS for precision in PRECISIONS]
    print(f"| force | {' | '.join(head)} |\n|" + " --- |" * (1 + len(head)))
    for k, name in enumerate(ROWS):
        cells = [cell(times[k], times[0]) for column in columns for times in column]
        print(f"| {name} | {' | '.join(cells)} |")
    print(f"\n{conditions(['numba'])}")


if __name__ == "__main__":
    main()
