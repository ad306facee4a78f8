"""What a tolerance costs against the best fixed choice, on every contact-free scene: a table.

    python benchmarks/error_control.py

Force evaluations of the solution and of all, its estimate included, both also over those of the
cheapest fixed method and step that search finds; error and estimate over what was asked.
"""

from __future__ import annotations

import math

import clothsim as cs
import numpy as np

SCENES = {
    "paper_swing(bend=True)": (cs.scenes.paper_swing(bend=True), 0.5),
    "paper_swing()": (cs.scenes.paper_swing(), 0.5),
    "hanging()": (cs.scenes.hanging(), 1.0),
    "oscillator()": (cs.scenes.oscillator(), 1.0),
    "oscillator(damping=3)": (cs.scenes.oscillator(damping=3.0), 1.0),
}
EXPONENTS = range(3, 11)
RATIO = 1.08  # between the steps that are searched


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def fixed(scene: cs.Scene, duration: float, steps: int, integrator: str) -> np.ndarray:
    state = scene.initial_position, scene.initial_velocity
    return cs.step(scene, *state, duration / steps, steps, integrator=integrator)[0]


def search(scene: cs.Scene, duration: float, exact: np.ndarray) -> list[tuple[int, float, str]]:
    """(force evaluations, error, method) of every fixed choice, cheapest first."""
    small = scene.cloth.rows * scene.cloth.columns < 10
    damped = scene.cloth.point_damping > 0 or any(scene.cloth.family_damping.values())
    found = []
    for name, method in cs.integrators().items():
        if not method.explicit:
            continue
        cost = method.evaluations_per_step(damped)
        steps = max(2, int(0.5 * duration / cs.max_stable_dt(scene, name)))
        while steps * cost < (500 if small else 6000):
            try:
                error = rms(fixed(scene, duration, steps, name) - exact)
                found.append((steps * cost, error, name))
            except cs.UnstableError:
                pass
            steps = max(steps + 1, math.ceil(RATIO * steps))
    return sorted(found)


def main() -> None:
    print(
        "| scene | asked / size | method | solution | all | best fixed | ratio | ratio of all | "
        "error / asked | estimate / asked |"
    )
    print("|" + " --- |" * 10)
    for name, (scene, duration) in SCENES.items():
        exact = fixed(scene, duration, 1000 if scene.cloth.rows > 16 else 300, "dop853")
        choices = search(scene, duration, exact)
        for exponent in EXPONENTS:
            asked = 10.0**-exponent
            run = cs.simulate(scene, duration, rtol=asked)
            report = run.report
            solution, spent = report["solution_evaluations"], report["force_evaluations"]
            best, _, method = next(choice for choice in choices if choice[1] <= asked)
            print(
                f"| {name} | 1e-{exponent} | {report['integrator']}, {report['precision']} | "
                f"{solution:,} | {spent:,} | {best:,} ({method}) | {solution / best:.2f} | "
                f"{spent / best:.2f} | {rms(run.x[-1] - exact) / asked:.2f} | "
                f"{report['error_estimate']['rms'] / asked:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
