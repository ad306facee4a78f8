"""Cost of `cs.settle` beside waiting for the damped motion, in force evaluations and seconds.

Usage: python benchmarks/settle.py [--tolerance 1e-6] [--most 400] [SCENE ...]

The damped motion is that of the scene itself, by RK4 at nine tenths of its guaranteed time step.
The unbalanced force is measured every half second of the scene, until it is below the tolerance or
--most seconds have passed.
"""

import argparse
import time
import warnings

import clothsim as cs
import numpy as np


def curtain():
    """Seven pins along one side."""
    return cs.Scene(cs.Cloth(pins=[(int(row), 0) for row in np.linspace(0, 31, 7)]))


def drape():
    """Return a light sheet on a sphere, hung by its corners."""
    corners = ((0, 0), (-1, 0), (0, -1), (-1, -1))
    cloth = cs.Cloth((24, 24), mass=0.3, stiffness=100.0, damping=0.05, pins=corners)
    return cs.Scene(cloth, cs.Sphere((0.5, -0.3, 0.5), 0.25))


SCENES = {"paper_swing": cs.scenes.paper_swing, "curtain of 7 pins": curtain, "drape": drape}


def unbalanced(scene, x, dt):
    """Largest unbalanced force over the largest weight: momentum that a step from rest leaves."""
    x, v = cs.step(scene, x, np.zeros_like(x), 0.01 * dt, t=0.0, integrator="semi_implicit_euler")
    force = scene.cloth.mass_per_point * np.linalg.norm(v, axis=-1) / (0.01 * dt)
    return force[~scene.cloth.pinned].max() / (
        scene.cloth.mass_per_point.max() * np.linalg.norm(scene.gravity)
    )


def damped_motion(scene, tolerance, limit):
    """Force evaluations, seconds and the residual of the motion of the scene itself."""
    dt = 0.9 * cs.max_stable_dt(scene)
    stepper = cs.Stepper(scene)
    steps = int(0.5 / dt)
    begin = time.perf_counter()
    while stepper.time < limit:
        stepper.advance(steps, dt)
        residual = unbalanced(scene, stepper.positions, dt)
        if residual < tolerance:
            break
    return 4 * round(stepper.time / dt), time.perf_counter() - begin, residual


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "scenes", nargs="*", choices=[[], *SCENES], metavar="SCENE", help=f"of {', '.join(SCENES)}"
    )
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument(
        "--most", type=float, default=400.0, help="seconds of damped motion, at most"
    )
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    print(
        "| scene | evaluations | s | residual | damped motion: evaluations | s | residual | "
        "ratio |\n|" + " --- |" * 8
    )
    for name in args.scenes or SCENES:
        scene = SCENES[name]()
        begin = time.perf_counter()
        report = cs.settle(scene, args.tolerance).report
        seconds = time.perf_counter() - begin
        count, duration, residual = damped_motion(scene, args.tolerance, args.most)
        ratio = (
            f"{'' if residual < args.tolerance else '> '}{count / report['force_evaluations']:.0f}"
        )
        ours = f"{report['force_evaluations']:,} | {seconds:.2f} | {report['residual']:.1e}"
        print(
            f"| {name} | {ours} | {count:,} | {duration:.1f} | {residual:.1e} | {ratio} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
