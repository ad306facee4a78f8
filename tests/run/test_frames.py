"""Frames never change a run: between two fixed steps they are interpolated."""

import clothsim as cs
import numpy as np
import pytest

DURATION = 0.3
SCHEDULES = (
    {"fps": 30},
    {"every": 0.0123},
    {"times": [0.0400001, 0.1, 0.10003, 0.10005, 0.2999]},
    {"every": 7},
    {"every": 1},
)
SWING = cs.scenes.paper_swing().replace(
    cloth=cs.Cloth((6, 5), (1, 1), mass=1.0, stiffness=100.0, damping=0.5)
)


def moving_ball(response="ray"):
    material = {} if response == "penalty" else {"restitution": 0.5}
    ball = cs.Sphere((0.5, -0.5, 0.5), 0.2, cs.Linear((0, 2.0, 0)), response, "none", **material)
    return cs.Scene(cs.Cloth((9, 9), (1, 1), mass=1.0, stiffness=200.0, damping=0.1), ball)


@pytest.mark.parametrize("frames", SCHEDULES, ids=str)
@pytest.mark.parametrize("dt, steps", [(1e-3, 300), (1.7e-3, 177), (0.5, 1)])
def test_the_end_has_the_same_bits_with_and_without_frames(frames, dt, steps, same_bits):
    scene = SWING if dt == 0.5 else moving_ball()
    if dt == 0.5:
        scene = scene.replace(cloth=scene.cloth.replace(stiffness=0.1, damping=0.0))
    plain, framed = (cs.simulate(scene, DURATION, dt=dt, **kwargs) for kwargs in ({}, frames))
    assert same_bits([plain.x[-1], plain.v[-1]], [framed.x[-1], framed.v[-1]])
    assert framed.report["steps"] == plain.report["steps"] == steps
    assert framed.t[-1] == DURATION


def test_interpolated_frames_are_of_order_four():
    times = np.array([0.0507, 0.1513, 0.2991])
    exact = cs.simulate(SWING, DURATION, rtol=1e-12, times=times)
    errors = []
    for dt in (4e-3, 2e-3):
        run = cs.simulate(SWING, DURATION, dt=dt, times=times)
        errors.append((abs(run.x - exact.x).max(), abs(run.v - exact.v).max()))
    ratios = np.divide(*errors)
    assert 12 < ratios[0] < 20 and 6 < ratios[1] < 20
    assert errors[1][0] < 1e-6


def test_a_frame_within_the_shorter_last_step():
    times = np.array([0.2951, 0.2983])  # 42 steps end at 0.294 s, and the last takes 6 ms
    exact = cs.simulate(SWING, DURATION, rtol=1e-12, times=times)
    run = cs.simulate(SWING, DURATION, dt=7e-3, times=times)
    assert abs(run.x - exact.x).max() < 1.5 * abs(run.x[-1] - exact.x[-1]).max()


@pytest.mark.parametrize("response", ["reflect", "ray"])
def test_an_interpolated_frame_is_no_deeper_in_a_sphere_than_the_states_beside_it(response):
    scene = moving_ball(response)
    dt = 5e-3
    steps = cs.simulate(scene, DURATION, dt=dt, every=1)
    run = cs.simulate(scene, DURATION, dt=dt, every=dt / 7.3)
    depth = steps.penetration()["points"]
    for t, frame_depth in zip(run.t, run.penetration()["points"]):
        k = min(int(t / dt), len(depth) - 2)
        assert frame_depth <= max(depth[k], depth[k + 1]) + 1e-12
    assert run.report["first_contact"]["time"] > 0


def test_a_triangle_of_an_interpolated_frame_dips_in_by_less_than_it_grows_in_the_step():
    ball = cs.Sphere((0.5, -0.45, 0.5), 0.4, cs.Reciprocate((0, 1, 0), 0.3, 0.4), friction=0.3)
    scene = cs.Scene(cs.Cloth((6, 6), mass=0.4, stiffness=30.0, damping=0.02, pins=()), ball)
    run = cs.simulate(scene, 0.3, fps=400)
    assert run.report["penetration"]["triangles"] == 0
    # Without the cells' part of the contact radius it is 4e-3.
    assert run.penetration()["triangles"].max() < 1e-3


def test_a_callback_that_stops_between_two_steps_leaves_the_next_state_last(same_bits):
    run = cs.simulate(SWING, DURATION, dt=2e-3, fps=30, callback=lambda t, x, v: t > 0.06)
    assert run.report["stopped"] == "callback"
    assert run.t[-2] == pytest.approx(2 / 30) and run.t[-1] == pytest.approx(0.068)
    rest = run.resume(DURATION - run.t[-1])
    expected = cs.simulate(SWING, DURATION, dt=2e-3)
    assert same_bits([rest.x[-1]], [expected.x[-1]])


def test_arrays_of_a_callback_cannot_be_made_writeable():
    calls = []

    def callback(t, x, v):
        calls.append((x, x.copy()))
        for array in (x, v):
            assert array.shape == (32, 32, 3) and array.dtype == np.float64
            while isinstance(array, np.ndarray):
                with pytest.raises(ValueError, match="WRITEABLE"):
                    array.flags.writeable = True
                array = array.base

    run = cs.simulate(cs.scenes.paper_moving(), 0.01, dt=1e-3, every=2, callback=callback)
    assert all(np.array_equal(x, copy) for x, copy in calls)
    assert np.array_equal(run.x, [x for x, _ in calls])
