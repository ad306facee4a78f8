"""Runs by tolerance reach the error asked for, estimate it well, and end."""

import functools
import json
import math
import os
import signal
import threading
import warnings

import clothsim as cs
import numpy as np
import pytest
from clothsim.engine.options import Options
from clothsim.run.reasons import Reason
from clothsim.run.recording import Recording, Watch
from clothsim.run.trajectory import Job
from random_cloths import draw, rms, truth

SWING = cs.scenes.paper_swing(bend=True)
OSCILLATOR = cs.scenes.oscillator()
DAMPED = cs.scenes.oscillator(damping=3.0)


@functools.cache
def exact_positions(scene, duration):
    """Return the positions at the end, by small fixed steps of dop853."""
    state = scene.initial_position, scene.initial_velocity
    return cs.step(scene, *state, duration / 1000, 1000, integrator="dop853")[0]


def check_estimate(run, error, least=0.5, most=3.0):
    estimate = run.report["error_estimate"]
    assert estimate["reason"] == ""
    assert least * error <= estimate["rms"] <= most * error
    assert estimate["rms"] <= estimate["max"]


# The scenes are those of the benchmark's stream that tunes; their starts are crumpled, moving,
# stretched and flat.
@pytest.mark.parametrize("number", [3, 6, 25, 28, 41, 46])
def test_random_scenes_against_another_model(number, tmp_path):
    case = draw(1, number)
    x, accuracy = truth(case, tmp_path)
    size = max(case.scene.cloth.size)
    for rtol in (1e-3, 1e-5, 1e-7):
        run = cs.simulate(case.scene, case.duration, rtol=rtol)
        error = rms(run.x[-1] - x)
        assert error <= rtol * size
        if error > 10 * accuracy:
            check_estimate(run, error)


@pytest.mark.parametrize(
    "integrator, rtol",
    [
        ("rk4", 1e-6),
        ("velocity_verlet", 1e-4),
        ("dopri5", 1e-6),
        ("semi_implicit_euler", 1e-3),
        ("pefrl", 1e-4),
        ("dop853", 1e-6),
        ("implicit_midpoint", 1e-3),
    ],
)
def test_every_named_method_runs_by_tolerance(integrator, rtol):
    """Run pefrl too, which has order 1 with damping."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = cs.simulate(DAMPED, 1.0, rtol=rtol, integrator=integrator)
    assert run.report["integrator"] == integrator
    error = rms(run.x[-1] - exact_positions(DAMPED, 1.0))
    assert error <= rtol
    check_estimate(run, error)


def test_the_estimate_of_a_given_step(precision):
    scene = SWING
    run = cs.simulate(scene, 0.5, dt=8e-4, precision=precision, estimate_error=True)
    check_estimate(run, rms(run.x[-1] - exact_positions(SWING, 0.5)))
    assert math.isnan(run.report["tolerance"]["asked"])


@functools.cache
def hard_case(name):
    """Return a scene and a duration: errors grow at least 1e12 times, or springs are stiff."""
    rng = np.random.default_rng(5)
    cloth = cs.Cloth(shape=(5, 5), mass=1.0, stiffness=1e3, damping=0.0, pins=())
    if name == "chaotic":
        return cs.Scene(cloth, velocity=2 * rng.standard_normal((5, 5, 3))), 5.0
    if name == "collapsed":
        return cs.Scene(
            cloth, position=1e-3 * cloth.rest_positions + 1e-5 * rng.standard_normal((5, 5, 3))
        ), 0.6
    stiff = cs.Cloth(shape=(5, 5), mass=0.1, stiffness=1e7, damping=300.0, pins=((0, 0),))
    return cs.Scene(stiff), 0.004


@functools.cache
def plain_evaluations(name):
    """Count the force evaluations of a run of dop853 at the smallest tolerance of a step."""
    scene, duration = hard_case(name)
    job = Job(
        [scene],
        False,
        duration,
        Options("dop853", "double", 1),
        tolerance=1e-14 * max(scene.cloth.size),
    )
    return Recording(job, Watch()).run_to_end().trajectory().evaluations


@pytest.mark.parametrize("options", [{}, {"rtol": 1e-4}, {"rtol": 1e-9}, {"rtol": 1e-15}], ids=str)
@pytest.mark.parametrize("name", ["chaotic", "collapsed", "stiff"])
def test_no_call_is_without_an_end(name, options):
    """It costs less than three plain runs; an estimate and a reason tell what it returns."""
    scene, duration = hard_case(name)
    run = cs.simulate(scene, duration, threads=1, **options)
    plain = max(plain_evaluations(name), run.report["solution_evaluations"])
    assert run.report["force_evaluations"] < 3 * plain
    assert run.t[-1] == duration and run.report["stopped"] == ""
    estimate = run.report["error_estimate"]
    if name == "stiff" and options != {"rtol": 1e-15}:
        assert estimate["reason"] == "" and estimate["rms"] < 1e-4
    elif name != "stiff":
        if "do not approach each other" in estimate["reason"]:
            assert np.isnan(estimate["rms"])
        else:
            assert estimate["reason"].startswith("runs with more steps come no closer")
            assert estimate["rms"] > 1e-4


def test_an_interrupt_hands_over_the_run_that_is_whole():
    scene = SWING
    times = []

    def interrupt(t, x, v):
        times.append(t)
        if times.count(0.0) == 2 and t > 0.1:
            os.kill(os.getpid(), signal.SIGINT)

    if threading.current_thread() is not threading.main_thread():
        pytest.skip("signals go to the main thread")
    with pytest.raises(cs.RunInterrupted) as caught:
        cs.simulate(scene, 0.5, rtol=1e-6, times=[0.2, 0.3, 0.4], callback=interrupt)
    run = caught.value.run
    assert run.t[-1] == 0.5 and len(run.t) == 5
    assert run.report["stopped"] == "interrupted"


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", ["dop853", "dopri5"])
def test_frames_do_not_shorten_steps(integrator):
    scene = SWING
    options = {"rtol": 1e-8, "integrator": integrator}
    plain = cs.simulate(scene, 0.1, **options)
    run = cs.simulate(scene, 0.1, every=0.0013, **options)
    assert run.report["steps"] == plain.report["steps"]
    assert run.x[-1].tobytes() == plain.x[-1].tobytes()
    np.testing.assert_allclose(run.t[:-1], 0.0013 * np.arange(len(run.t) - 1), rtol=1e-15)
    assert run.x[0].tobytes() == scene.initial_position.tobytes()
    for k in (1, 10, 40, 76):
        steps = 40
        x, v = cs.step(
            scene,
            scene.initial_position,
            scene.initial_velocity,
            run.t[k] / steps,
            steps,
            integrator="dop853",
        )
        assert rms(run.x[k] - x) < 3e-8
        assert rms(run.v[k] - v) < 3e-5


def test_after_contact_no_error_is_told():
    scene = cs.scenes.paper_static(bend=True)
    report = cs.simulate(scene, 0.4, rtol=1e-5, every=0.02).report
    assert math.isnan(report["error_estimate"]["max"])
    assert report["error_estimate"]["reason"].startswith("an obstacle responded")
    assert report["force_evaluations"] < 2 * report["solution_evaluations"]
    fixed = cs.simulate(scene, 0.3, dt=1e-4).report
    assert abs(report["first_contact"]["time"] - fixed["first_contact"]["time"]) < 5e-4
    free = cs.simulate(scene, 0.2, rtol=1e-5).report
    assert free["error_estimate"]["rms"] < 1e-5
    assert fixed["error_estimate"]["reason"] == Reason.NOT_ASKED
    assert report.keys() == free.keys() == fixed.keys()
    assert json.loads(json.dumps(report)).keys() == report.keys()


@pytest.mark.parametrize("threads", [1, 3])
def test_same_bits_for_any_number_of_threads(threads, kernel):
    scene = cs.scenes.paper_static(bend=True)
    runs = [
        cs.simulate(
            scene, 0.25, rtol=1e-4, integrator="dop853", kernel=kernel, threads=n, every=0.1
        )
        for n in (2, threads)
    ]
    assert runs[0].x.tobytes() == runs[1].x.tobytes()
    assert runs[0].report["steps"] == runs[1].report["steps"]


def test_a_state_that_cannot_be_integrated_is_an_error():
    scene = OSCILLATOR
    velocity = np.zeros((1, 2, 3))
    velocity[0, 1, 0] = 1e300
    with pytest.raises(cs.UnstableError) as raised:
        cs.simulate(cs.Scene(scene.cloth, velocity=velocity), 1.0, rtol=1e-3, integrator="dop853")
    assert raised.value.point == (0, 1)
    energy = raised.value.run.report["energy"]
    assert np.isnan(energy["end"]["total"]) and "finite" in energy["reason"]


@pytest.mark.parametrize("name", ["sampling", "max_evaluations"])
def test_arguments_that_left_are_unknown(name):
    with pytest.raises(TypeError, match=f"argument '{name}'"):
        cs.simulate(OSCILLATOR, 1.0, **{name: 9})
