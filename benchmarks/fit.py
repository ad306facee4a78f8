"""Whether `cs.fit` is off by what it says: random cloths with noise, and starts that are off by a
factor of ten.

Usage: python benchmarks/fit.py [--scenes 40] [--draws 20] [--starts 3] [--seed 0]

The first table has the scatter of (fitted - true) / (stated sigma) for each kind of parameter,
which should be 1. The second has how many starts, with each positive parameter off by a factor of
ten, reach the minimum that the true values reach.
"""

import argparse
import time
from collections import defaultdict

import clothsim as cs
import numpy as np

KINDS = (
    "stiffness_structural",
    "stiffness_shear",
    "stiffness_bend",
    "damping",
    "drag",
    "mass",
    "gravity_y",
    "pin0_x",
)
TIMES = np.linspace(0.05, 1.0, 20)


def draw(rng):
    """Return a scene, and the names of some parameters that a measured motion determines."""
    shape = tuple(int(n) for n in rng.integers(3, 7, 2))
    mass = 10 ** rng.uniform(-1, 1)
    omega = rng.uniform(20, 60)  # 1/s, of a spring
    count = shape[0] * shape[1]
    stiffness = {
        f: mass / count * omega**2 * part
        for f, part in zip(("structural", "shear", "bend"), (1, 0.5, 0.3))
    }
    cloth = cs.Cloth(
        shape, (0.5, 0.5), mass, stiffness, damping=0.02 * mass * omega / count, drag=mass / count
    )
    scene = cs.Scene(
        cloth,
        position=cloth.rest_positions
        + rng.normal(0, 0.002, (*shape, 3)) * ~cloth.pinned[..., None],
    )
    names = [name for name in KINDS[:5] if rng.random() < 0.6] or ["drag"]
    # the scale of mass and forces is then known
    if "stiffness_shear" not in names and rng.random() < 0.7:
        names.append("mass")
    return scene, [*names, *(name for name in KINDS[6:] if rng.random() < 0.4)]


def value(scene, name):
    return float(cs.sensitivity(scene, TIMES[:1], [name]).value[0])


def replace_values(scene, values):
    """Return the scene with other values of positive parameters."""
    cloth = scene.cloth
    scalars = {name: value for name, value in values.items() if name in ("mass", "damping", "drag")}
    parts = {
        name.removeprefix("stiffness_"): value
        for name, value in values.items()
        if name.startswith("stiffness_")
    }
    return scene.replace(cloth=cloth.replace(stiffness={**cloth.stiffness, **parts}, **scalars))


def judge(scenes, draws, starts, seed):
    """By kind: deviations in stated sigmas; starts off by ten: (reached, told that not, all)."""
    scatter = defaultdict(list)
    outcomes = np.zeros(3, int)
    for number in range(scenes):
        rng = np.random.default_rng([seed, number])
        truth, names = draw(rng)
        motion = cs.simulate(truth, TIMES[-1], rtol=1e-9, times=TIMES).x[1:]
        true = {name: value(truth, name) for name in names}
        for k in range(draws):
            data = motion + rng.normal(0, 5e-4, motion.shape)
            fit = cs.fit(truth, TIMES, data, over=names, sigma=5e-4)
            for name in names:
                if np.isfinite(fit.errors[name]):
                    scatter[name].append((fit.values[name] - true[name]) / fit.errors[name])
            if k:
                continue
            for _ in range(starts):
                far_values = {
                    name: value * 10.0 ** rng.choice([-1, 1])
                    for name, value in true.items()
                    if name in KINDS[:6]
                }
                far = cs.fit(replace_values(truth, far_values), TIMES, data, over=names, sigma=5e-4)
                same = abs(far.report["chi_square"] / fit.report["chi_square"] - 1) < 1e-6
                outcomes += same, not same and bool(far.report["reason"]), 1
    return scatter, outcomes


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in (("scenes", 40), ("draws", 20), ("starts", 3), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    begin = time.perf_counter()
    scatter, (reached, reports, starts) = judge(args.scenes, args.draws, args.starts, args.seed)
    print(
        "| parameter | fits | scatter / stated sigma | mean / stated sigma |\n| --- | --- | "
        "--- | --- |"
    )
    for name in filter(scatter.get, KINDS):
        print(
            f"| {name} | {len(scatter[name])} | {np.std(scatter[name]):.2f} | "
            f"{np.mean(scatter[name]):+.2f} |"
        )
    print(
        f"\nstarts off by ten: {reached} of {starts} reached the minimum, {reports} of the "
        "others said so"
    )
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
