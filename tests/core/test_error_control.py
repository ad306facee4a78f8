"""Runs by tolerance: the error that is asked for is had, told, and paid for reasonably."""

import functools

import clothsim as cs
import numpy as np
import pytest
from clothsim import adaptive

DURATIONS = {"swing": 0.5, "swing with bend": 0.5, "hanging": 1.0, "oscillator": 1.0, "damped": 1.0}


@functools.cache
def scene_of(name):
    return {
        "swing": lambda: cs.scenes.paper_swing(),
        "swing with bend": lambda: cs.scenes.paper_swing(bend=True),
        "hanging": lambda: cs.scenes.hanging(),
        "oscillator": lambda: cs.scenes.oscillator(),
        "damped": lambda: cs.scenes.oscillator(damping=3.0),
    }[name]()


@functools.cache
def exact(name):
    """x at the end by small fixed steps of dop853."""
    scene, duration = scene_of(name), DURATIONS[name]
    steps = 1000 if "swing" in name else 300
    return cs.step(
        scene, scene.initial_position, scene.initial_velocity, duration / steps, steps,
        integrator="dop853",
    )[0]  # fmt: skip


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def test_the_reference_is_that_of_another_method():
    scene = scene_of("swing with bend")
    x, _ = cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-4, 5000)
    assert rms(x - exact("swing with bend")) < 2e-10  # of RK4 at this step


@pytest.mark.parametrize("exponent", range(3, 11))
@pytest.mark.parametrize("name", DURATIONS)
def test_the_error_asked_for_is_had(name, exponent):
    scene, asked = scene_of(name), 10.0**-exponent
    run = cs.simulate(scene, DURATIONS[name], rtol=asked)
    error, estimate = rms(run.x[-1] - exact(name)), run.report["error_estimate"]["rms"]
    assert run.t[-1] == DURATIONS[name]
    assert error <= asked
    assert run.report["tolerance"]["asked"] == asked
    # The estimate is not below the error's size, or both are far below what matters.
    floor = max(run.report["tolerance"]["floor"], 1e-3 * asked)
    assert error < 3 * estimate + floor
    assert estimate <= max(asked, 10 * floor)
    # Where the tolerance decides the steps, it is not far above either.
    if exponent >= 9 and name != "hanging":
        assert estimate < 3 * error + floor


@pytest.mark.parametrize("asked, most", [(1e-9, 2600), (1e-11, 4500)])
def test_force_evaluations_of_the_paper_swing(asked, most):
    scene = scene_of("swing with bend")
    run = cs.simulate(scene, 0.5, atol=asked)
    assert rms(run.x[-1] - exact("swing with bend")) <= asked
    assert run.report["solution_evaluations"] <= most
    parts = ("solution_evaluations", "estimate_evaluations")
    assert run.report["force_evaluations"] == sum(run.report[part] for part in parts)
    assert run.report["integrator"] == "dop853"
    assert run.report["rejected_steps"] < run.report["steps"] / 10


@pytest.mark.parametrize("asked, most", [(1e-9, 3300), (1e-11, 6700)])
def test_force_evaluations_of_the_paper_swing_with_its_estimate(asked, most):
    report = cs.simulate(scene_of("swing with bend"), 0.5, atol=asked).report
    assert report["force_evaluations"] <= most


def test_companions_are_counted():
    for scene, duration, asked in (
        (scene_of("oscillator"), 1.0, 1e-8), (cs.scenes.paper_static(), 0.3, 1e-3),
    ):  # fmt: skip
        report = cs.simulate(scene, duration, rtol=asked).report
        assert report["estimate_evaluations"] > 0.5 * report["solution_evaluations"]
        assert report["estimate_wall_time"] > 0


def test_a_step_that_turns_out_unstable_is_taken_shorter(monkeypatch):
    monkeypatch.setattr(adaptive, "_NEAR", 1.5)
    scene, asked = scene_of("swing with bend"), 1e-5
    run = cs.simulate(scene, 0.5, rtol=asked)
    assert run.report["integrator"] == "rk4"
    assert run.report["dt"] <= cs.max_stable_dt(scene, "rk4") * 1.5
    assert rms(run.x[-1] - exact("swing with bend")) <= asked
    with pytest.raises(cs.UnstableError):
        cs.simulate(scene, 0.5, dt=2 * cs.max_stable_dt(scene, "rk4") * 1.4)


@pytest.mark.parametrize("asked", [1e-5, 1e-8])
def test_the_cost_is_that_of_the_best_fixed_choice(asked):
    """... found by search over methods and steps, within a factor of 1.5."""
    scene = scene_of("swing with bend")
    state = scene.initial_position, scene.initial_velocity
    best = np.inf
    for integrator, counts in {
        "velocity_verlet": (550, 900), "rk4": (290, 318, 400, 600), "dop853": (135, 150, 165, 190),
        "dopri5": (290, 400, 600),
    }.items():  # fmt: skip
        for n in counts:
            try:
                x, _ = cs.step(scene, *state, 0.5 / n, n, integrator=integrator)
            except cs.UnstableError:
                continue
            if rms(x - exact("swing with bend")) <= asked:
                best = min(best, n * cs.integrators()[integrator].evaluations_per_step(True))
    assert np.isfinite(best)
    run = cs.simulate(scene, 0.5, rtol=asked)
    assert run.report["solution_evaluations"] <= 1.5 * best
    assert run.report["force_evaluations"] <= 1.5 * best


@pytest.mark.parametrize("integrator", ["rk4", "velocity_verlet", "dopri5", "dop853"])
@pytest.mark.parametrize("asked", [1e-4, 1e-6])
def test_every_method_runs_by_tolerance(integrator, asked):
    run = cs.simulate(scene_of("damped"), 1.0, rtol=asked, integrator=integrator)
    assert run.report["integrator"] == integrator
    assert rms(run.x[-1] - exact("damped")) <= asked


def test_without_step_or_tolerance():
    scene = scene_of("swing with bend")
    report = cs.simulate(scene, 0.1).report
    assert report["integrator"] == "rk4"
    assert report["dt"] <= 0.5 * cs.max_stable_dt(scene)
    assert 0 < report["error_estimate"]["rms"] < 1e-3
    scene = scene_of("oscillator")
    run = cs.simulate(scene, 1.0)
    assert rms(run.x[-1] - exact("oscillator")) < 1e-3


def test_the_floor_of_rounding_is_told():
    scene = scene_of("swing")
    report = cs.simulate(scene, 0.5, rtol=1e-14).report
    tolerance = report["tolerance"]
    assert tolerance["below_floor"]
    assert 1e4 < tolerance["growth"] < 1e8
    assert tolerance["floor"] == np.finfo(float).eps * tolerance["growth"]
    assert report["error_estimate"]["rms"] < 10 * tolerance["floor"]
    # Out of reach is no reason to spend more.
    assert report["solution_evaluations"] < 6000
    above = cs.simulate(scene_of("oscillator"), 1.0, rtol=1e-12).report["tolerance"]
    assert not above["below_floor"] and above["growth"] < 10


@pytest.mark.parametrize("integrator", ["dop853", "dopri5"])
def test_frames_do_not_shorten_steps(integrator):
    scene = scene_of("swing with bend")
    options = {"rtol": 1e-8, "integrator": integrator}
    alone = cs.simulate(scene, 0.1, **options)
    run = cs.simulate(scene, 0.1, every=0.0013, **options)
    assert run.report["steps"] == alone.report["steps"]
    assert run.x[-1].tobytes() == alone.x[-1].tobytes()
    np.testing.assert_allclose(run.t[:-1], 0.0013 * np.arange(len(run.t) - 1), rtol=1e-15)
    for k in (1, 10, 40, 76):
        steps = 40
        x, v = cs.step(
            scene, scene.initial_position, scene.initial_velocity, run.t[k] / steps, steps,
            integrator="dop853",
        )  # fmt: skip
        assert rms(run.x[k] - x) < 3e-8
        assert rms(run.v[k] - v) < 3e-5


def test_an_integer_every_counts_accepted_steps():
    run = cs.simulate(scene_of("swing"), 0.1, rtol=1e-6, integrator="dop853", every=4)
    assert len(run.t) == 2 + (run.report["steps"] - 1) // 4
    assert (np.diff(run.t) > 0).all()


@pytest.mark.parametrize("integrator", ["dop853", "dopri5"])
def test_no_contact_is_skipped(integrator):
    """A sphere at 100 m/s through a soft cloth: the points it meets are those that small steps find."""
    cloth = cs.Cloth(shape=(16, 16), mass=25.6, stiffness=100.0, damping=0.0)
    sphere = cs.Sphere((0.5, -1.0, 0.5), 0.2, cs.Linear((0.0, 100.0, 0.0)))
    scene = cs.Scene(cloth, sphere, gravity=(0.0, 0.0, 0.0))
    run = cs.simulate(scene, 0.02, rtol=1e-2, integrator=integrator)
    small = cs.simulate(scene, 0.02, dt=1e-5)
    met, expected = (np.linalg.norm(r.v[-1], axis=-1) > 50 for r in (run, small))
    assert expected.sum() == 32
    assert (met == expected).all()
    # No step near the sphere was longer than a tenth of its contact radius at its speed.
    radius = sphere.contact_radius(cloth)
    assert run.report["steps"] >= 2 * radius / (0.1 * radius)
    assert run.report["steps"] < 200


def test_after_contact_outcomes_are_compared():
    scene = cs.scenes.paper_static(bend=True)
    run = cs.simulate(scene, 0.4, rtol=1e-5, every=0.02)
    report = run.report
    assert report["chaotic"] is True and report["error_estimate"] is None
    outcomes = report["outcomes"]
    assert set(outcomes) == {
        "first_contact", "centre_of_mass", "kinetic_energy", "total_energy", "penetration",
    }  # fmt: skip
    assert abs(outcomes["first_contact"]["value"] - 0.2258) < 0.004
    assert 0 < outcomes["first_contact"]["difference"] < 0.004
    assert report["penetration"]["points"] < 1e-12  # the response has moved every point out
    before = cs.simulate(scene, 0.2, rtol=1e-5).report
    assert before["chaotic"] is False and before["error_estimate"]["rms"] < 1e-5


@pytest.mark.parametrize("threads", [1, 3])
def test_same_bits_for_any_number_of_threads(threads, kernel):
    scene = cs.scenes.paper_static(bend=True)
    runs = [
        cs.simulate(scene, 0.25, rtol=1e-6, integrator="dop853", kernel=kernel, threads=n, every=0.1)
        for n in (2, threads)
    ]
    assert runs[0].x.tobytes() == runs[1].x.tobytes()
    assert runs[0].report["steps"] == runs[1].report["steps"]


def test_a_state_that_cannot_be_integrated_is_an_error():
    scene = scene_of("oscillator")
    velocity = np.zeros((1, 2, 3))
    velocity[0, 1, 0] = 1e300
    with pytest.raises(cs.UnstableError):
        cs.simulate(cs.Scene(scene.cloth, velocity=velocity), 1.0, rtol=1e-3, integrator="dop853")


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"dt": 1e-3, "rtol": 1e-3}, ValueError, "dt must be None with rtol or atol"),
        ({"rtol": 0.0}, ValueError, "rtol or atol must be > 0, got 0 for both"),
        ({"rtol": -1e-3}, ValueError, "rtol must be a finite number >= 0, got -0.001"),
        ({"atol": "small"}, TypeError, "atol must be a finite number >= 0, got 'small'"),
        ({"dt": 1e-3, "integrator": "auto"}, ValueError, "integrator must be a name with dt"),
        ({"rtol": 1e-3, "integrator": "euler"}, ValueError, "integrator must be one of 'auto'"),
        ({"rtol": 1e-3, "every": 0}, ValueError, "every must be steps between frames"),
        ({"rtol": 1e-3, "every": -0.1}, ValueError, "every must be a finite number > 0"),
    ],
)  # fmt: skip
def test_arguments_are_checked(arguments, error, message):
    with pytest.raises(error, match=message):
        cs.simulate(scene_of("oscillator"), 1.0, **arguments)
