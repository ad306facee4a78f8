"""Judge the error that runs with forces tell, on random scenes without contact: a wind with gusts
in half of them, and a random function of time and state, the argument `force`, in the others.

python benchmarks/random_forces.py --count 200 --seed 1000
python benchmarks/random_forces.py --count 60 --order

Each scene is run at a random tolerance, and again at one a thousand times tighter. A run misses
where its distance from the better run is above twice what it tells and above what was asked.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter, defaultdict
from dataclasses import dataclass, replace

import clothsim as cs
import numpy as np
from random_cloths import rms
from random_contacts import draw_cloth

GRAVITY = 9.80665  # m/s^2
TIGHTEST = 1e-12  # rtol of a better run
GUSTS = ("none", "sinusoid", "smooth", "rest")
# An order is that of two errors at least so many times the error of the run that both are compared
# with, and at most this part of the size.
CLEAR, SMALL = 100.0, 1e-4
HALVINGS = 5  # of the step


class RandomForce:
    """A smooth force on each mass point, about as large as its weight: waves, drag and a magnet."""

    def __init__(self, rng: np.random.Generator, cloth: cs.Cloth) -> None:
        count = rng.integers(1, 5)
        self.weight = GRAVITY * cloth.mass_per_point[..., None]  # N
        self.amplitude = rng.normal(0, 1, (count, 3)) * rng.uniform(0, 1) / count  # weights
        self.rate = rng.uniform(0, 40, count)  # rad/s
        self.wave = rng.normal(0, 5, (count, 3))  # rad/m
        self.phase = rng.uniform(0, 2 * np.pi, count)
        self.drag = rng.choice([0, rng.uniform(0, 0.5)])  # weights per m/s
        self.pull = rng.choice([0, rng.uniform(-1, 2)])  # weights per m
        self.magnet = rng.uniform(-1, 1, 3)  # m

    def __call__(self, t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        waves = np.sin(self.rate * t + x @ self.wave.T + self.phase) @ self.amplitude
        return self.weight * (waves - self.drag * v - self.pull * (x - self.magnet))


def draw_gusts(rng: np.random.Generator, kind: str) -> cs.Sinusoid | cs.Keyframes | None:
    """Return a motion of air, with speeds of some metres a second."""
    if kind == "none":
        return None
    if kind == "sinusoid":
        frequency = 10 ** rng.uniform(-0.5, 1.2)
        amplitude = rng.normal(0, 3, 3) / (2 * np.pi * frequency)
        return cs.Sinusoid(amplitude, frequency, rng.uniform(0, 1))
    times = np.cumsum(rng.uniform(0.05, 0.3, rng.integers(2, 6))) - rng.uniform(0, 0.3)
    steps = rng.normal(0, 3, (len(times), 3)) * np.diff(times, prepend=times[0])[:, None]
    return cs.Keyframes(times, offsets=np.cumsum(steps, axis=0), smooth=kind == "smooth" or kind)


def draw_wind(rng: np.random.Generator, kind: str) -> cs.Wind:
    """Return a wind from a light breeze to a storm."""
    direction = rng.normal(0, 1, 3)
    velocity = direction / np.linalg.norm(direction) * rng.uniform(0, 15)
    tangential = float(rng.choice([0, 0.05, rng.uniform(0, 0.5)]))
    normal = rng.uniform(0.2, 2)
    return cs.Wind(velocity, normal=normal, tangential=tangential, motion=draw_gusts(rng, kind))


@dataclass(frozen=True)
class Case:
    """A scene, the function that acts on it, and the seconds that it runs."""

    kind: str
    scene: cs.Scene
    force: RandomForce | None
    duration: float

    def run(self, **options: object) -> cs.Run:
        return cs.simulate(self.scene, self.duration, force=self.force, **options)


def draw_case(rng: np.random.Generator) -> Case:
    """Return a random cloth with a wind or with a random force."""
    cloth = draw_cloth(rng)
    duration = rng.uniform(0.3, 0.8)
    if rng.random() < 0.5:
        return Case("force", cs.Scene(cloth), RandomForce(rng, cloth), duration)
    kind = str(rng.choice(GUSTS))
    return Case(f"wind, gusts: {kind}", cs.Scene(cloth, wind=draw_wind(rng, kind)), None, duration)


def judge_estimates(seeds: range) -> None:
    """Compare what runs tell of their errors with better runs."""
    counts = dict.fromkeys(("judged", "missed", "without an estimate", "not reached"), 0)
    reasons = Counter[str]()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        case = draw_case(rng)
        rtol = 10 ** rng.uniform(-9, -4)
        run, better = case.run(rtol=rtol), case.run(rtol=max(1e-3 * rtol, TIGHTEST))
        error = run.report["error_estimate"]
        tolerance = rtol * max(case.scene.cloth.size)
        estimate = error["rms"]
        distance = rms(run.x[-1] - better.x[-1])
        uncertainty = better.report["error_estimate"]["rms"]
        text = (
            f"{seed} ({case.kind}): asked {tolerance:.1e} m, told {estimate:.1e} m, "
            f"off {distance:.1e} m, known to {uncertainty:.1e} m"
        )
        counts["judged"] += 1
        if error["reason"]:
            counts["without an estimate" if np.isnan(estimate) else "not reached"] += 1
            reasons[error["reason"]] += 1
            print(f"{text}; {error['reason']}", flush=True)
        if distance > 2 * estimate and distance > tolerance:
            counts["missed"] += 1
            print(f"{text}: missed", flush=True)
    for reason, count in reasons.most_common():
        print(f"{count} x {reason}")
    print(", ".join(f"{n} {name}" for name, n in counts.items()), end="")


def judge_order(seeds: range) -> None:
    """Measure the order of rk4 at steps that are halved, from the errors of the last positions.

    Pins rest. A table of keys has a jump of the second derivative of its velocity at each, and a
    fixed step across it an error of order 3.
    """
    orders = defaultdict[str, list[float]](list)
    for seed in seeds:
        case = draw_case(np.random.default_rng(seed))
        scene = case.scene.replace(cloth=case.scene.cloth.replace(pins=case.scene.cloth.pinned))
        case = replace(case, scene=scene)
        right = case.run(rtol=TIGHTEST)
        uncertainty = right.report["error_estimate"]["rms"]
        size = max(scene.cloth.size)
        steps = int(case.duration / (0.8 * cs.max_stable_dt(scene))) + 1
        runs = [case.run(dt=case.duration / (steps * 2**k)) for k in range(HALVINGS + 1)]
        errors = [rms(run.x[-1] - right.x[-1]) for run in runs]
        clear = [e for e in errors if CLEAR * uncertainty < e < SMALL * size]
        if len(clear) > 1:
            orders[case.kind].append(float(np.log2(clear[-2] / clear[-1])))
            print(f"{seed} ({case.kind}): order {orders[case.kind][-1]:.2f}", flush=True)
    for kind, values in sorted(orders.items()):
        low, middle, high = np.quantile(values, [0, 0.5, 1])
        print(f"{kind}: {len(values)} of order {low:.2f} to {high:.2f}, median {middle:.2f}")
    print(f"{sum(map(len, orders.values()))} of {len(seeds)} with an order", end="")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--order", action="store_true", help="measure the order of rk4")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    begin = time.perf_counter()
    judge = judge_order if args.order else judge_estimates
    judge(range(args.seed, args.seed + args.count))
    print(f" in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
