"""A whole run: frames, the last shorter step, the report, and the file."""

import json
import math

import clothsim as cs
import numpy as np
import pytest
from clothsim.run.reasons import Reason

SCENE = cs.scenes.paper_static()


def test_only_the_first_and_last_frame_by_default(same_bits):
    run = cs.simulate(SCENE, 0.01, dt=1e-3)
    np.testing.assert_array_equal(run.t, [0.0, 0.01])
    assert run.x.shape == run.v.shape == (2, 32, 32, 3)
    assert run.x.dtype == run.v.dtype == np.float64
    start = SCENE.initial_position, SCENE.initial_velocity
    assert same_bits((run.x[0], run.v[0]), start)
    assert same_bits((run.x[1], run.v[1]), cs.step(SCENE, *start, 1e-3, 10))


@pytest.mark.parametrize(
    "every, times",
    [
        (4, [0, 0.004, 0.008, 0.01]),
        (5, [0, 0.005, 0.01]),
        (1, np.arange(11) * 1e-3),
        (10, [0, 0.01]),
        (99, [0, 0.01]),
        (np.int64(5), [0, 0.005, 0.01]),
        (0.004, [0, 0.004, 0.008, 0.01]),
        (0.0025, [0, 0.0025, 0.005, 0.0075, 0.01]),
        (0.01, [0, 0.01]),
        (3.0, [0, 0.01]),
        (np.float64(0.005), [0, 0.005, 0.01]),
    ],
    ids=str,
)
def test_frames(every, times):
    run = cs.simulate(SCENE, 0.01, dt=1e-3, every=every)
    np.testing.assert_allclose(run.t, times, rtol=1e-12)
    assert run.t[-1] == 0.01
    assert len(run.x) == len(run.v) == len(times)


def test_the_last_step_is_shorter_where_dt_does_not_divide():
    run = cs.simulate(SCENE, 0.0105, dt=1e-3)
    state = cs.step(SCENE, run.x[0], run.v[0], 1e-3, 10)
    state = cs.step(SCENE, *state, 5e-4, 1, t=0.01)
    assert run.report["steps"] == 11 and run.t[-1] == 0.0105
    np.testing.assert_allclose(run.x[-1], state[0], rtol=0, atol=1e-14)


def test_the_report():
    run = cs.simulate(SCENE, 0.01, dt=1e-3, precision="single", threads=2, kernel="gather")
    report = run.report
    assert report["steps"] == 10 and report["force_evaluations"] == 40
    assert report["dt"] == 1e-3 and report["integrator"] == "rk4"
    assert report["wall_time"] > 0
    np.testing.assert_allclose(report["steps_per_second"], 10 / report["wall_time"])
    assert report["kernel"] == "gather"
    assert report["precision"] == "single" and report["threads"] == 2
    assert report["instruction_set"] == cs.build_config()["instruction_set"]
    assert report["version"] == cs.__version__
    assert report["error_estimate"]["reason"] == Reason.NOT_ASKED
    for moment, k in (("start", 0), ("end", -1)):
        assert report["energy"][moment] == cs.energy(SCENE, run.x[k], run.v[k])
    assert report["energy"]["gained"] >= 0 and report["energy"]["reason"] == ""
    assert report["penetration"] == {"points": 0.0, "triangles": 0.0, "reason": ""}
    assert report["stretch"]["largest"] == cs.largest_stretch(SCENE, run.x).max()
    first = report["first_contact"]
    assert math.isnan(first.pop("time")) and first == {"reason": "no sphere responded"}
    text = json.dumps(report)  # Texts are compared, as NaN is not equal to itself.
    assert json.dumps(json.loads(text)) == text
    assert cs.simulate(SCENE, 0.001).report["kernel"] in ("gather", "edge")


def test_without_dt_a_safe_one_is_taken():
    run = cs.simulate(SCENE, 0.01)
    assert run.report["error_estimate"]["rms"] <= 1e-3
    scene = cs.Scene(cs.Cloth((2, 2), stiffness=0.0, damping=0.0))
    run = cs.simulate(scene, 0.5)
    np.testing.assert_allclose(run.x[-1, 0, 1, 1], -9.80665 / 8, rtol=1e-12)


def test_the_report_has_the_step_that_was_taken():
    scene = cs.scenes.oscillator()
    for options, dt, steps in [
        ({"dt": 1.0}, 0.01, 1),
        ({"dt": 1e-3, "fps": 5000}, 1e-3, 10),
        ({"dt": 4e-3}, 4e-3, 3),
    ]:
        run = cs.simulate(scene, 0.01, **options)
        assert run.report["steps"] == steps and abs(run.report["dt"] / dt - 1) < 1e-9
        assert f" of {dt:.4g} s by rk4" in str(run)


def test_a_duration_that_no_clock_resolves_is_refused():
    with pytest.raises(ValueError, match="duration must be at least 1e-150 s, got 5e-324"):
        cs.simulate(cs.scenes.oscillator(), 5e-324)
    x, v = np.zeros((2, 32, 32, 3))
    for call in (
        lambda: cs.step(cs.scenes.paper_moving(), x, v, 1e-5, t=1e20),
        lambda: cs.Stepper(cs.scenes.paper_moving(), x, v, t=1e20).advance(1, 1e-5),
        lambda: cs.step(cs.scenes.paper_moving(), x, v, 1e-5, t=1e20),  # with the spare state
    ):
        with pytest.raises(
            ValueError, match="dt must be above the rounding of the time t = 1e.20 s"
        ):
            call()


def test_more_frames_than_a_list_holds_are_refused_before_the_run():
    scene = cs.scenes.paper_swing()
    for frames, name in [
        ({"fps": 1e8}, "fps"),
        ({"every": 1e-9}, "every"),
        ({"every": 2}, "every"),
    ]:
        with pytest.raises(ValueError, match=f"^{name} must give fewer than 10,000,000 frames"):
            cs.simulate(scene, 1.0, dt=1e-9, **frames)
