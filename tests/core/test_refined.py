"""Runs of few oscillations by tolerance: equal steps, where all of them are equally hard."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim import refined
from clothsim.runs import Options, rms

OPTIONS = Options("dop853", "double", 1, "auto", False)
SCENES = {"undamped": cs.scenes.oscillator(), "damped": cs.scenes.oscillator(damping=3.0)}


def at_the_end(scene, duration, steps, integrator="dop853"):
    state = scene.initial_position, scene.initial_velocity
    return cs.step(scene, *state, duration / steps, steps, integrator=integrator)[0]


def collapsing():
    """A chain of two springs that is let fall upright on its pinned end, a little aside."""
    cloth = cs.Cloth((3, 1), (1.0, 1.0), mass=0.6, stiffness=20.0, damping=0.0,
                     springs=("structural",), pins=[(0, 0)])  # fmt: skip
    x = np.zeros((3, 1, 3))
    x[:, 0, 0] = (0.0, 0.02, -0.03)
    x[:, 0, 1] = (0.0, 0.5, 1.0)
    return cs.Scene(cloth, position=x), 1.2


@pytest.mark.parametrize("exponent", range(3, 11))
@pytest.mark.parametrize("name", SCENES)
def test_as_few_steps_as_the_best_choice_takes_or_half_as_many_again(name, exponent):
    scene, asked = SCENES[name], 10.0**-exponent
    exact = at_the_end(scene, 1.0, 300)
    best = np.inf
    for integrator, method in cs.integrators().items():
        if not method.explicit:
            continue
        cost = method.evaluations_per_step(name == "damped")
        fewest = math.ceil(1 / cs.max_stable_dt(scene, integrator))
        for steps in range(max(2, fewest), 300 // cost):
            if rms(at_the_end(scene, 1.0, steps, integrator) - exact) <= asked:
                best = min(best, steps * cost)
    run = cs.simulate(scene, 1.0, rtol=asked)
    assert rms(run.x[-1] - exact) <= asked
    assert run.report["solution_evaluations"] <= 1.5 * best
    assert run.report["force_evaluations"] <= (2.4 if exponent > 4 else 3.0) * best


@pytest.mark.parametrize("name", SCENES)
def test_steps_are_equal_and_frames_come_for_free(name):
    scene = SCENES[name]
    alone = cs.simulate(scene, 1.0, rtol=1e-7)
    report = alone.report
    assert report["integrator"] == "dop853" and report["rejected_steps"] == 0
    assert report["solution_evaluations"] == 12 * report["steps"]
    # The bits of the fixed step, but for the rounding of the time.
    assert rms(alone.x[-1] - at_the_end(scene, 1.0, report["steps"])) < 1e-14
    run = cs.simulate(scene, 1.0, rtol=1e-7, every=0.037)
    assert run.report["steps"] == report["steps"]
    assert run.x[-1].tobytes() == alone.x[-1].tobytes()
    assert len(run.t) == 29
    for k in (1, 13, 27):
        assert rms(run.x[k] - at_the_end(scene, run.t[k], 100)) < 1e-6


def test_the_error_is_told():
    """Also where the error passes through 0, between 7 and 8 steps of the undamped one."""
    for scene in SCENES.values():
        exact = at_the_end(scene, 1.0, 300)
        ratios = []
        for goal in np.geomspace(1e-4, 1e-10, 25):
            found = refined.refine(scene, 1.0, goal, OPTIONS)
            ratios.append(rms(found.error) / rms(found.solution.x[-1] - exact))
            assert rms(found.error) <= goal
        assert min(ratios) > 1
        assert np.median(ratios) < (6 if scene is SCENES["undamped"] else 2)


def test_where_steps_are_not_equally_hard_a_controller_takes_over():
    scene, duration = collapsing()
    assert refined.is_few(scene, duration)
    exact = at_the_end(scene, duration, 4000)
    for asked in (1e-4, 1e-6, 1e-8):
        found = refined.refine(scene, duration, asked, OPTIONS)
        assert found.solution is None and found.evaluations > 0
        run = cs.simulate(scene, duration, rtol=asked)
        assert rms(run.x[-1] - exact) <= asked
        assert run.report["estimate_evaluations"] > found.evaluations
        assert run.report["solution_evaluations"] % 12 != 0  # its first step's is used again


def test_a_named_method_keeps_its_controller():
    scene = SCENES["damped"]
    named = cs.simulate(scene, 1.0, rtol=1e-7, integrator="dop853").report
    assert named["solution_evaluations"] != 12 * named["steps"]


def test_what_is_forgotten_is_not_magnified():
    """No twin runs where point damping takes every perturbation down."""
    reports = [cs.simulate(cs.scenes.hanging(), 1.0, rtol=rtol).report for rtol in (1e-9, 1e-10)]
    assert reports[0]["force_evaluations"] == reports[1]["force_evaluations"]
    assert reports[1]["tolerance"]["growth"] == 1.0
