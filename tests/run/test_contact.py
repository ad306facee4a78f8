"""Runs in penalty contact: the error that is told, misuse, warnings and errors."""

import pickle
import warnings

import clothsim as cs
import numpy as np
import pytest

BALL = cs.Sphere((0.5, -0.5, 0.5), 0.25)
SMALL = cs.Cloth((8, 8), mass=1.0, stiffness=300.0, damping=0.3, pins=())


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def test_the_error_is_told_while_the_cloth_lies_on_the_sphere():
    cloth = cs.Cloth((16, 16), mass=128.0, stiffness=35_000.0, damping=50.0, pins=())
    scene = cs.Scene(cloth, BALL)
    right = cs.simulate(scene, 0.6, rtol=1e-9)
    assert right.report["energy"]["end"]["contact"] > 1
    for rtol in (1e-3, 1e-5, 1e-7):
        run = cs.simulate(scene, 0.6, rtol=rtol)
        estimate = run.report["error_estimate"]
        assert estimate["reason"] == "" and estimate["rms"] <= rtol
        assert rms(run.x[-1] - right.x[-1]) <= max(2 * estimate["rms"], 1e-9)


@pytest.mark.parametrize("response", ["ray", "reflect"])
def test_the_paper_s_responses_have_no_error(response):
    run = cs.simulate(cs.scenes.paper_static(response), 0.3, rtol=1e-3)
    estimate = run.report["error_estimate"]
    assert np.isnan(estimate["rms"]) and "no part of the equation" in estimate["reason"]


def test_runs_that_part_are_told_with_their_distance():
    """A sheet without bend springs falls on its edge: it folds, and no two runs agree."""
    cloth = cs.Cloth((10, 10), mass=1.0, stiffness=2_000.0, damping=0.0, pins=())
    x = cloth.rest_positions[..., [0, 2, 1]] * (1, -1, 1) + (0.0, 1.05, 0.0)
    noise = np.random.default_rng(0).normal(0, 1e-3, x.shape)
    scene = cs.Scene(cloth, cs.Plane((0.0, 0.0, 0.0), dissipation=0.0), position=x + noise)
    estimate = cs.simulate(scene, 2.0, rtol=1e-6).report["error_estimate"]
    assert np.isnan(estimate["rms"]) and "do not approach each other" in estimate["reason"]


@pytest.mark.parametrize("integrator", ["rk4", "velocity_verlet", "semi_implicit_euler"])
def test_fixed_steps_under_a_tolerance_end_at_kinks(integrator):
    """A kick of 20 ms within a longer step would leave no trace."""
    offsets = [(0, 0, 0), (0, 0, 0), (0, 0.2, 0), (0, 0, 0), (0, 0, 0)]
    kick = cs.Keyframes((0, 0.3, 0.302, 0.322, 1), offsets=offsets)
    scene = cs.Scene(cs.Cloth((6, 6), mass=1.0, stiffness=200.0, damping=0.2, pins={(0, 0): kick}))
    right = cs.simulate(scene, 0.6, rtol=1e-6)
    run = cs.simulate(scene, 0.6, rtol=1e-3, integrator=integrator, fps=30)
    assert len(run.t) == 19 and run.t[-1] == 0.6
    assert rms(run.x[-1] - right.x[-1]) <= 2 * run.report["error_estimate"]["rms"] <= 2e-3


def test_first_contact_is_the_time_of_the_touch():
    scene = cs.Scene(SMALL, cs.Plane((0.0, -0.2, 0.0)))
    fall = 0.2 - cs.Plane().layer(SMALL)["thickness"]
    expected = np.sqrt(2 * fall / 9.80665)
    for options, slack in (({"dt": 1e-4}, 1e-4), ({"rtol": 1e-6}, 2e-2)):
        run = cs.simulate(scene, 0.3, **options)
        assert 0 <= run.report["first_contact"]["time"] - expected <= slack


def sheet_below_surface(depth):
    """Put a flat sheet at a depth [m] below the surface of a plane."""
    return cs.Scene(SMALL, cs.Plane((0.0, depth, 0.0)))


def test_a_start_below_the_surface_is_refused_and_changes_nothing():
    message = r"position must have the free mass points .* got mass point \(0, 0\) 0.01 m below"
    for call in (lambda s: cs.simulate(s, 0.1, dt=1e-4), cs.Stepper):
        with pytest.raises(ValueError, match=message):
            call(sheet_below_surface(0.01))
    stepper = cs.Stepper(sheet_below_surface(-1.0))
    stepper.advance(10, 1e-3)
    x = stepper.x
    scene = stepper.scene
    with pytest.raises(ValueError, match=r"below the true surface of spheres\[0\]"):
        stepper.set_scene(sheet_below_surface(0.01))
    assert np.array_equal(stepper.x, x) and stepper.scene == scene


def test_states_may_be_as_deep_as_the_layer():
    scene = sheet_below_surface(-0.5)
    h = cs.Plane().layer(SMALL)["thickness"]
    v = np.zeros((8, 8, 3))
    x = SMALL.rest_positions - (0.0, 0.5 + 0.9 * h, 0.0)
    cs.step(scene, x, v, 1e-4)
    deeper = x - (0.0, 0.2 * h, 0.0)
    for call in (
        lambda: cs.step(scene, deeper, v, 1e-4),
        lambda: cs.Stepper(scene).set_state(deeper, v),
    ):
        with pytest.raises(ValueError, match="outside its layer"):
            call()
    assert np.isfinite(cs.acceleration(scene, deeper, v)).all()
    assert cs.energy(scene, deeper, v)["contact"] > 0
    assert np.isfinite(cs.max_stable_dt(scene, x=deeper, v=v))


def test_a_start_deep_in_a_layer_and_pins_inside_are_warned_of():
    light = SMALL.replace(mass=0.01)
    with pytest.warns(cs.ContactWarning, match="starts .* deep in the layer of spheres"):
        cs.Stepper(cs.Scene(light, cs.Plane((0.0, -0.001, 0.0))))
    wall = cs.Sphere((0.0, 0.0, 0.0), 0.1)
    x = SMALL.rest_positions + (0.2, 0.0, 0.0)
    x[0, 0] = 0.0
    pinned = cs.Scene(SMALL.replace(pins=[(0, 0)]), wall, position=x)
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 0\) is inside"):
        cs.simulate(pinned, 0.001, dt=1e-4)


@pytest.mark.parametrize("options", [{"dt": 1e-4}, {"dt": 1e-3}, {"rtol": 1e-4}])
def test_a_fast_sphere_is_held_or_ends_the_run(options):
    bullet = cs.Sphere((0.5, -3.0, 0.5), 0.2, cs.Linear((0.0, 200.0, 0.0)))
    heavy = SMALL.replace(pins=[(0, 0), (0, -1), (-1, 0), (-1, -1)])
    for sphere in (bullet, bullet.replace(stiffness=2_000.0)):
        scene = cs.Scene(heavy, sphere, gravity=(0, 0, 0))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                run = cs.simulate(scene, 0.02, **options)
        except cs.ContactError as error:
            assert error.obstacle == 0 and error.run.t[-1] < 0.02
            assert "is held by a stiffness of" in str(error) or "take a dt of at most" in str(error)
        except cs.UnstableError as error:
            assert options == {"dt": 1e-3} and "more than the thickness of its layer" in str(error)
        else:
            assert sphere is bullet and (run.x[-1][..., 1].max() > 0.5)


def test_a_point_that_passes_ends_the_run_with_what_would_hold_it():
    floor = cs.Plane((0.0, -0.5, 0.0), stiffness=1.0, dissipation=0.0)
    scene = cs.Scene(SMALL, floor)
    for options in ({"dt": 1e-3}, {"rtol": 1e-4}):
        with pytest.raises(cs.ContactError, match=r"layer of spheres\[0\].* is held by") as raised:
            cs.simulate(scene, 1.0, **options)
        speed = np.linalg.norm(raised.value.v[raised.value.point])
        h = floor.layer(SMALL)["thickness"]
        assert f"stiffness of {2 / 64 * (speed / h) ** 2:.3g} N/m" in str(raised.value)
        stiff_floor = floor.replace(stiffness=4 / 64 * (speed / h) ** 2)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cs.simulate(cs.Scene(SMALL, stiff_floor), 0.5, **options)


def test_depths_judge_the_time_step():
    stiff = cs.Plane((0.0, -0.2, 0.0), stiffness=1e6, thickness=0.05)
    scene = cs.Scene(SMALL, stiff)
    dt = 0.9 * cs.max_stable_dt(scene)
    with pytest.warns(cs.StabilityWarning, match=r"deep in the layer of spheres\[0\]"):
        cs.simulate(scene, 0.3, dt=dt)
    x = SMALL.rest_positions - (0.0, 0.17, 0.0)
    assert cs.max_stable_dt(scene, x=x) < 0.5 * cs.max_stable_dt(scene, x=SMALL.rest_positions)
    assert "stiffness 1e+06 N/m" in scene.explain()["layers"][0]


def test_a_step_that_gains_energy_in_contact_ends_with_the_depth_named():
    floor = cs.Plane((0.0, -0.05, 0.0), stiffness=1e7, dissipation=0.0, thickness=0.05)
    scene = cs.Scene(SMALL.replace(damping=0.0), floor)
    dt = 0.95 * cs.max_stable_dt(scene, "velocity_verlet")
    message = r"at step \d+ .* deep in the layer of spheres"
    with (
        pytest.warns(cs.StabilityWarning, match="deep in"),
        pytest.raises(cs.UnstableError, match=message),
    ):
        cs.simulate(scene, 2.0, dt=dt, integrator="velocity_verlet")


def test_arguments_name_what_serves():
    for arguments, message in (
        ({"restitution": 0.5}, "dissipation takes its place"),
        ({"response": "ray", "thickness": 0.01}, "it belongs to response 'penalty'"),
        ({"thickness": 0.0}, "thickness must be"),
        ({"dissipation": -1.0}, "dissipation must be"),
        ({"as_printed": True}, "accepted with 'ray' and 'reflect'"),
    ):
        with pytest.raises(ValueError, match=message):
            cs.Sphere(**arguments)
    loose = cs.Cloth((4, 4), stiffness=0.0, pins=())
    with pytest.raises(ValueError, match="stiffness must be given"):
        cs.Plane().layer(loose)


def test_layers_follow_the_cloth_and_the_motion():
    layer = BALL.layer(cs.Cloth())
    spacing = 1 / 31
    assert layer["thickness"] == spacing / 4 and layer["stiffness"] == 10 * 35_000
    fast = BALL.replace(motion=cs.Linear((0, 100, 0))).layer(cs.Cloth())
    assert fast["stiffness"] == pytest.approx(2 * 0.5 * (100 / layer["thickness"]) ** 2)
    soft = cs.Plane().layer(SMALL.replace(stiffness=0.3))
    fastest = soft["thickness"] * np.sqrt(soft["stiffness"] * 64 / 2)
    assert soft["dissipation"] == pytest.approx(2 / fastest)
    assert soft["slip_speed"] == pytest.approx(fastest / 100)


def test_spheres_by_hand_have_the_speed_of_their_travel():
    scene = cs.Scene(SMALL, cs.Sphere((0.5, -0.45, 0.5), 0.2))
    stepper = cs.Stepper(scene)
    stepper.advance(300, 1e-3, centers={0: (0.5, -0.15, 0.5)})
    moving = scene.replace(spheres=scene.spheres[0].replace(motion=cs.Linear((0.0, 1.0, 0.0))))
    run = cs.simulate(moving, 0.3, dt=1e-3)
    assert run.report["first_contact"]["time"] < 0.25
    assert abs(stepper.x - run.x[-1]).max() < 1e-12


def test_the_error_of_a_point_that_passes_has_the_state_before_the_step(leak):
    stepper = cs.Stepper(leak())
    with pytest.raises(cs.ContactError, match=r"point \(0, 0\) has gone through") as caught:
        stepper.advance(1000, 1e-3)
    error = caught.value
    assert error.point == (0, 0) and error.obstacle == 0 and error.member is None
    assert "is held by a stiffness of" in error.remedy and str(error).endswith(error.remedy)
    assert error.step == pytest.approx(error.time / 1e-3) and 0.2 < error.time < 0.3
    assert np.array_equal(error.x, stepper.positions) and error.x[0, 0, 1] > -0.1
    assert stepper.time == pytest.approx(error.time - 1e-3)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_sphere_that_runs_into_a_pinned_point_warns_once_and_the_point_stays():
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 0), (0, 1)))
    x = np.array([[(0.0, 0.0, 0.0), (90.0, 90.0, 90.0)]])
    sphere = cs.Sphere((0, -1, 0), 0.5, cs.Linear((0, 1, 0)), thickness=0.01, stiffness=1.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0), x))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.advance(499, 1e-3)
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 0\)") as record:
        stepper.advance(101, 1e-3)
    assert len(record) == 1 and record[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.advance(100, 1e-3)
    assert not stepper.positions[0, 0].any() and not stepper.velocities[0, 0].any()
