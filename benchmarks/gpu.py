"""Method 2 of Kim et al. on CPU and graphics adapter, over cloth sizes and batches, in compensated
single.

    pip install 'clothsim[gpu]'
    python benchmarks/gpu.py                                     # every adapter; some minutes
    python benchmarks/gpu.py --sizes 32 256 --batches 64 > gpu.csv

Prints a CSV line for each: the cloth's side and the number of cloths, by what they are stepped,
microseconds a step, and nanoseconds a mass point and step. A cloth lies on the sphere from the
first step on. The least of the windows counts.
"""

import argparse
from contextlib import nullcontext
from functools import partial
from time import perf_counter

import clothsim as cs
import numpy as np
from clothsim.gpu import adapters, using


def drape(size):
    """Return the paper's cloth with more points on the cap of its sphere, and a stable step [s]."""
    radius, depth = 0.25, 0.2
    sphere = cs.Sphere((0.5, -depth, 0.5), radius, response="ray", offset="edge")
    cloth = cs.Cloth((size, size), springs=("structural", "shear"))
    x = np.array(cloth.rest_positions)
    distance = np.hypot(x[..., 0] - 0.5, x[..., 2] - 0.5)
    x[..., 1] = np.maximum(
        x[..., 1], np.sqrt(np.maximum(sphere.contact_radius(cloth) ** 2 - distance**2, 0)) - depth
    )
    scene = cs.Scene(cloth, sphere, position=x)
    return scene, min(cs.scenes.PAPER_DT, 0.5 * cs.max_stable_dt(scene))


def seconds_per_step(scene, dt, members, seconds, windows=5, **options):
    """Seconds a step takes, the least of some windows of about `seconds`."""
    x = np.stack([scene.initial_position] * members)
    stepper = cs.Stepper(scene, x, precision="single", **options)
    best = np.inf
    steps = 8
    for _ in range(windows + 1):  # the first makes buffers and pipelines
        begin = perf_counter()
        stepper.advance(steps, dt)
        stepper.time  # noqa: B018
        best = min(best, (perf_counter() - begin) / steps)
        steps = max(8, int(seconds / best))
    return best


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="*", default=[32, 64, 128, 256, 512, 1024])
    parser.add_argument(
        "--batches",
        type=int,
        nargs="*",
        default=[16, 256, 1024],
        help="numbers of cloths of 32 x 32",
    )
    parser.add_argument("--seconds", type=float, default=0.5, help="of a window (default 0.5)")
    args = parser.parse_args()
    threads = cs.build_config()["threads"]
    targets = [(f"core, {n} threads", nullcontext, {"threads": n}) for n in sorted({1, threads})]
    targets += [
        (a.name + " (a CPU)" * a.software, partial(using, a), {"backend": "gpu"})
        for a in adapters()
    ]
    print("side,cloths,by,us_per_step,ns_per_point_step")
    for side, cloths in [(n, 1) for n in args.sizes] + [(32, n) for n in args.batches]:
        scene, dt = drape(side)
        for name, context, options in targets:
            try:
                with context():
                    seconds = seconds_per_step(scene, dt, cloths, args.seconds, **options)
            except (MemoryError, ValueError) as error:  # the adapter has not so much memory
                print(f"# {side} x {side}, {cloths} cloths, {name}: {error}")
                continue
            print(
                f'{side},{cloths},"{name}",{1e6 * seconds:.4g},'
                f"{1e9 * seconds / (side * side * cloths):.4g}",
                flush=True,
            )


if __name__ == "__main__":
    main()
