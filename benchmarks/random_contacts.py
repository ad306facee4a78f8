"""Judge the error that runs in contact tell, on random scenes with layers.

python benchmarks/random_contacts.py --count 300 --seed 5000

Each scene is run at a random tolerance, and again at one a thousand times tighter. A run misses
where its distance from the better run is above twice what it tells and above what was asked.
"""

from __future__ import annotations

import argparse
import time
import warnings

import clothsim as cs
import numpy as np
from random_cloths import rms

KINDS = ("none", "none", "linear", "reciprocate", "sinusoid", "keyframes", "smooth")


def draw_motion(rng: np.random.Generator) -> cs.Linear | cs.Keyframes | None:
    """Return a motion of a random kind, or None."""
    kind = rng.choice(KINDS)
    direction = rng.normal(0, 1, 3)
    direction /= np.linalg.norm(direction)
    if kind == "none":
        return None
    if kind == "linear":
        return cs.Linear(direction * rng.uniform(0, 0.5))
    if kind == "reciprocate":
        return cs.Reciprocate(direction, rng.uniform(0.02, 0.15), rng.uniform(0.2, 0.8))
    if kind == "sinusoid":
        return cs.Sinusoid(direction * rng.uniform(0.01, 0.08), rng.uniform(0.5, 4))
    times = np.sort(rng.uniform(0, 0.6, 3)) + np.arange(3) * 0.05
    times[0] = 0
    offsets = np.vstack([np.zeros(3), rng.normal(0, 0.03, (2, 3))])
    return cs.Keyframes(times, offsets=offsets, smooth=kind == "smooth")


def draw_cloth(rng: np.random.Generator) -> cs.Cloth:
    """Return a free or hung sheet, light or heavy, whose pins may move."""
    shape = tuple(int(n) for n in rng.integers(4, 13, 2))
    points = shape[0] * shape[1]
    mass = points * 10 ** rng.uniform(-3, -0.3)
    stiffness = 10 ** rng.uniform(1.5, 4.5)
    damping = float(rng.choice([0, 1]) * stiffness * 10 ** rng.uniform(-4, -2.7))
    pins = {}
    if rng.random() < 0.5:
        for pin in [(0, 0), (0, -1)][: rng.integers(1, 3)]:
            motion = draw_motion(rng) if rng.random() < 0.3 else None
            pins[pin] = None if isinstance(motion, cs.Keyframes) else motion
    families = ("structural", "shear", "bend") if rng.random() < 0.7 else ("structural", "shear")
    drag = float(rng.choice([0, 1]) * mass / points * rng.uniform(0, 2))
    size = tuple(rng.uniform(0.5, 1, 2))
    return cs.Cloth(shape, size, mass, stiffness, damping, drag, families, pins or ())


def draw_obstacle(rng: np.random.Generator, size: tuple[float, float]) -> cs.Sphere | cs.Plane:
    """Return a sphere or a plane below the sheet."""
    friction = float(rng.choice([0, 0, rng.uniform(0.05, 0.8)]))
    if rng.random() < 0.6:
        radius = rng.uniform(0.08, 0.3)
        x, z = rng.uniform(0.1, 0.9, 2) * (size[1], size[0])
        center = (x, -radius - rng.uniform(0.02, 0.25), z)
        return cs.Sphere(center, radius, draw_motion(rng), friction=friction)
    normal = (rng.normal(0, 0.2), 1, rng.normal(0, 0.2))
    point = (size[1] / 2, -rng.uniform(0.15, 0.4), size[0] / 2)
    return cs.Plane(point, normal, draw_motion(rng), friction=friction)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    begin = time.perf_counter()
    counts = dict.fromkeys(("judged", "missed", "without an estimate", "ended by an error"), 0)
    for seed in range(args.seed, args.seed + args.count):
        rng = np.random.default_rng(seed)
        cloth = draw_cloth(rng)
        obstacles = [draw_obstacle(rng, cloth.size) for _ in range(rng.integers(1, 4))]
        scene = cs.Scene(cloth, obstacles)
        duration = rng.uniform(0.15, 0.7)
        rtol = 10 ** rng.uniform(-7, -3)
        try:
            run = cs.simulate(scene, duration, rtol=rtol)
            better = cs.simulate(scene, duration, rtol=max(1e-3 * rtol, 1e-11))
        except (ValueError, cs.ContactError) as error:  # a start inside, or a layer that is passed
            counts["ended by an error"] += 1
            print(f"{seed}: {type(error).__name__}: {str(error)[:90]}")
            continue
        estimate = run.report["error_estimate"]["rms"]
        tolerance = rtol * max(cloth.size)
        error = rms(run.x[-1] - better.x[-1])
        counts["judged"] += 1
        counts["without an estimate"] += int(np.isnan(estimate))
        if error > 2 * estimate and error > tolerance:
            counts["missed"] += 1
            uncertainty = better.report["error_estimate"]["rms"]
            print(f"{seed}: told {estimate:.1e} m, off {error:.1e} m, known to {uncertainty:.1e} m")
    print(", ".join(f"{n} {name}" for name, n in counts.items()), end="")
    print(f" in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
