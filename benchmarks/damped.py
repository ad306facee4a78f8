"""Judge rkc2 on damped cloths: its cost beside that of dop853, and the error that it tells.

python benchmarks/damped.py
python benchmarks/damped.py --count 100 --seed 7000
python benchmarks/damped.py --plot docs/images/damped.png

Without options it prints evaluations of force and errors of both methods, of 32 x 32 points that
swing from an edge for 0.5 s: 0.2 kg/m2, 1,000 N/m, damping over stiffness 2.9e-3 s. With --count it
draws scenes at random. Errors are distances from a run of dop853 at a tolerance a hundred times
tighter. A run misses where its error is above twice what it tells and above what was asked.
"""

import argparse
import warnings

import clothsim as cs
import fabrics
import numpy as np
from common import aligned, conditions
from random_cloths import rms

LOSS = 2.9e-3  # s
ASKED = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def swing():
    return cs.Scene(
        cs.Cloth(
            (32, 32),
            mass=0.2,
            stiffness=1000.0,
            damping=LOSS * 1000.0,
            pins=[(0, column) for column in range(32)],
        )
    )


def draw(rng):
    """Return a damped scene, hung or free, bare or with drag, wind or a layer, and a duration."""
    shape = tuple(int(n) for n in rng.integers(4, 20, 2))
    size = tuple(rng.uniform(0.3, 1.5, 2))
    points = shape[0] * shape[1]
    mass = size[0] * size[1] * 10 ** rng.uniform(-1, 0.3)
    stiffness = 10 ** rng.uniform(1.5, 4)
    families = ("structural", "shear", "bend") if rng.random() < 0.6 else ("structural", "shear")
    stiffnesses = {family: stiffness * 10 ** rng.uniform(-1, 0) for family in families}
    loss = 10 ** rng.uniform(-3, -1.5)
    damping = {family: loss * value for family, value in stiffnesses.items()}
    drag = float(rng.choice([0, 1]) * mass / points * 10 ** rng.uniform(-1, 1))
    pins = [[], [(0, 0), (0, -1)], [(0, column) for column in range(shape[1])]][rng.integers(3)]
    obstacles = []
    wind = None
    if not pins or rng.random() < 0.3:
        radius = float(rng.uniform(0.1, 0.4))
        center = (size[0] * rng.random(), -radius - rng.uniform(0.05, 0.2), size[1] * rng.random())
        obstacles = [cs.Sphere(center, radius, friction=float(rng.choice([0, 0.3])))]
    if rng.random() < 0.3:
        wind = cs.Wind(tuple(rng.normal(0, 4, 3)))
    cloth = cs.Cloth(shape, size, mass, stiffnesses, damping, drag, families, pins)
    return cs.Scene(cloth, obstacles, wind=wind), float(rng.uniform(0.1, 1))


def run_both(scene, duration, rtol):
    """Return a run of rkc2 and its error [m]; NaN where dop853 does not reach its tolerance."""
    run = cs.simulate(scene, duration, rtol=rtol, integrator="rkc2")
    better = cs.simulate(scene, duration, rtol=rtol / 100, integrator="dop853")
    error = rms(run.x[-1] - better.x[-1])
    is_known = better.report["error_estimate"]["rms"] <= 0.1 * error
    return run, better, error if is_known else np.nan


def print_costs():
    print(conditions())
    rows = []
    for rtol in ASKED:
        run, _, error = run_both(swing(), 0.5, rtol)
        dop853 = cs.simulate(swing(), 0.5, rtol=rtol, integrator="dop853").report
        report = run.report
        rows.append(
            [
                f"{rtol:g}",
                f"{error:.1e}",
                f"{report['error_estimate']['rms']:.1e}",
                f"{report['solution_evaluations']:,}",
                f"{report['force_evaluations']:,}",
                f"{dop853['force_evaluations']:,}",
            ]
        )
    head = ["asked", "error [m]", "told", "evaluations of the run", "of all", "of all of dop853"]
    print(aligned(head, rows))


def judge(count, seed):
    """Print the runs that miss, and how many there are."""
    misses = verdicts = silences = excesses = 0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        scene, duration = draw(rng)
        rtol = 10 ** rng.uniform(-6, -2)
        try:
            run, better, error = run_both(scene, duration, rtol)
        except (cs.UnstableError, cs.ContactError) as failure:
            print(number, "ended:", str(failure)[:150])
            continue
        report = run.report
        estimate = report["error_estimate"]["rms"]
        request = rtol * max(scene.cloth.size)
        silences += np.isnan(estimate)
        excesses += estimate > request
        if np.isnan(estimate) or np.isnan(error):
            continue
        verdicts += 1
        ratio = report["force_evaluations"] / better.report["force_evaluations"]
        if error > max(2 * estimate, request):
            misses += 1
            print(f"{number}: told {estimate:.2g}, off {error:.2g}, asked {request:.2g}, {scene}")
        print(
            f"{number}: asked {request:.1e} told {estimate:.1e} off {error:.1e}, "
            f"evaluations {ratio:.2g} of dop853 at a hundredth"
        )
    print(f"{misses} of {verdicts} miss; {silences} untold; {excesses} not reached")


def plot(file):
    """Draw error over cost of a denim of 16 x 16 points that swings for 0.2 s."""
    denim = fabrics.scene(*fabrics.FABRICS["denim"], LOSS, 16)
    longest = 0.95 * cs.max_stable_dt(denim)
    data = cs.work_precision(
        denim,
        0.2,
        ["rk4", "dop853 adaptive", "rkc2 adaptive"],
        dts=[longest, longest / 2],
        rtols=[10.0**-k for k in range(2, 9)],
    )
    data.clothsim.plot()[0].figure.savefig(file, dpi=80)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--seed", type=int, default=7000)
    parser.add_argument("--plot", metavar="FILE")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    if arguments.plot:
        plot(arguments.plot)
    elif arguments.count:
        judge(arguments.count, arguments.seed)
    else:
        print_costs()


if __name__ == "__main__":
    main()
