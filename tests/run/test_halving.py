"""Fixed steps of Verlet are halved where an error is asked for: their cost and error.

Other scenes are left to dop853.
"""

import clothsim as cs
import numpy as np
import pytest
from random_cloths import draw, rms

DENIM = cs.Scene(cs.Cloth((16, 16), mass=0.3, stiffness=600.0, damping=0.0))


def evaluations(run):
    return run.report["force_evaluations"]


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_an_undamped_cloth_costs_little_more_than_its_fixed_steps(rtol):
    run = cs.simulate(DENIM, 0.25, rtol=rtol)
    assert run.report["integrator"] == "velocity_verlet"
    assert run.report["dt"] <= cs.max_stable_dt(DENIM, "velocity_verlet") / 2
    right = cs.simulate(DENIM, 0.25, rtol=1e-9)
    assert right.report["integrator"] == "dop853"
    error = rms(run.x[-1] - right.x[-1])
    assert error <= run.report["error_estimate"]["rms"] <= min(rtol, 4 * error)
    fixed = cs.simulate(DENIM, 0.25, dt=run.report["dt"], integrator="velocity_verlet")
    assert (run.x == fixed.x).all()
    assert evaluations(run) < 1.8 * evaluations(fixed)
    assert evaluations(run) < evaluations(cs.simulate(DENIM, 0.25, rtol=rtol, integrator="dop853"))


def drag(t, x, v):
    return -1e-3 * v


@pytest.mark.parametrize(
    "change, options",
    [
        ({}, {"rtol": 1e-7}),
        ({}, {"force": drag}),
        ({"cloth": DENIM.cloth.replace(drag=1e-4)}, {}),
        ({"spheres": cs.Sphere((0.5, -5.0, 0.5), 0.25, dissipation=0.0)}, {}),
        ({"cloth": DENIM.cloth.replace(pins={(0, 0): cs.Sinusoid((0.01, 0, 0), 2.0)})}, {}),
        ({"wind": cs.Wind((1.0, 0.0, 0.0))}, {}),
    ],
    ids=["tight", "force", "drag", "sphere", "driven", "wind"],
)
def test_other_scenes_are_left_to_dop853(change, options):
    run = cs.simulate(DENIM.replace(**change), 0.05, **{"rtol": 1e-4, **options})
    assert run.report["integrator"] == "dop853"


def test_runs_that_do_not_approach_each_other_are_left_to_dop853():
    """Crumpled sheets magnify differences: halved steps are no nearer to the motion."""
    rng = np.random.default_rng(1)
    x = DENIM.initial_position + rng.normal(size=DENIM.initial_position.shape) * 0.02
    x[DENIM.cloth.pinned] = DENIM.initial_position[DENIM.cloth.pinned]
    wild = DENIM.replace(position=x)
    run = cs.simulate(wild, 1.0, rtol=1e-6)
    assert run.report["integrator"] == "dop853"


@pytest.mark.parametrize("number", range(100, 112))
def test_errors_are_told_on_random_scenes(number):
    case = draw(1, number)
    scene = case.scene.replace(cloth=case.scene.cloth.replace(damping=0.0, drag=0.0))
    run = cs.simulate(scene, case.duration, rtol=1e-4)
    right = cs.simulate(scene, case.duration, rtol=1e-8)
    estimate = run.report["error_estimate"]
    if estimate["reason"]:
        return
    assert estimate["rms"] <= 1e-4 * max(scene.cloth.size)
    error = rms(run.x[-1] - right.x[-1])
    if right.report["error_estimate"]["rms"] < 0.1 * error:
        assert error <= 2 * estimate["rms"]
