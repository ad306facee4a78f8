"""A run's start time and frames, its callback, and what an early end leaves."""

import signal
import threading

import clothsim as cs
import numpy as np
import pytest
from clothsim.engine.options import Options
from clothsim.run.frames import Frames
from clothsim.run.recording import Recording, Watch
from clothsim.run.trajectory import Job

SCENE = cs.scenes.paper_swing()
SMALL = SCENE.replace(cloth=SCENE.cloth.replace(shape=(6, 7), mass=21.0))


def frame(run, k):
    return run.x[k], run.v[k]


@pytest.mark.parametrize(
    "options",
    [{"dt": 1e-3}, {"rtol": 1e-3, "integrator": "dop853"}, {"rtol": 1e-4, "integrator": "rk4"}],
    ids=str,
)
def test_times_are_stored_as_given_between_the_ends(options):
    times = [0.0031, 0.005, 0.0082]
    run = cs.simulate(SCENE, 0.01, times=times, **options)
    assert run.t.tolist() == [0.0, *times, 0.01]
    for k, t in enumerate(times, 1):
        expected = cs.simulate(SCENE, t, rtol=1e-9)
        assert abs(run.x[k] - expected.x[-1]).max() < 1e-5


def test_times_at_the_ends_are_not_stored_twice():
    run = cs.simulate(SMALL, 0.3, dt=1e-3, times=np.linspace(0.0, 0.3, 4))
    np.testing.assert_allclose(run.t, [0.0, 0.1, 0.2, 0.3], rtol=1e-15)
    run = cs.simulate(SMALL, 0.3, dt=1e-3, t=2.0, times=[2.0, 2.1, 2.3 + 1e-12])
    assert run.t.tolist() == [2.0, 2.1, 2.3]


def test_fps_are_frames_a_second(same_bits):
    run = cs.simulate(SMALL, 0.1, dt=1e-3, fps=30)
    assert run.t.tolist() == [0.0, 1 / 30, 2 / 30, 0.1]
    assert cs.simulate(SMALL, 0.25, dt=1e-3, fps=4).t.tolist() == [0.0, 0.25]
    dense = cs.simulate(SMALL, 0.1, rtol=1e-6, integrator="dop853", fps=30)
    plain = cs.simulate(SMALL, 0.1, rtol=1e-6, integrator="dop853")
    assert dense.t.tolist() == run.t.tolist()
    assert same_bits(frame(dense, -1), frame(plain, -1))


@pytest.mark.parametrize("count", [2, 3])
def test_frames_of_accepted_steps_also_after_a_first_contact(count):
    """The steps before the first contact are taken one by one."""
    scene = cs.scenes.paper_static().replace(velocity=None)
    run = cs.simulate(scene, 0.3, rtol=1e-3, integrator="dopri5", every=1)
    assert run.report["first_contact"]["time"] < 0.28
    assert len(run.t) == run.report["steps"] + 1 and (np.diff(run.t) > 0).all()
    part = cs.simulate(scene, 0.3, rtol=1e-3, integrator="dopri5", every=count)
    expected = run.t[::count].tolist()
    assert part.t.tolist() == expected + ([] if expected[-1] == 0.3 else [0.3])


@pytest.mark.parametrize(
    "options",
    [
        {"dt": 1e-3},
        {"rtol": 1e-4},
        {"rtol": 1e-4, "integrator": "dop853"},
        {"dt": 1e-3, "estimate_error": True},
        {"integrator": "rk4"},
    ],
    ids=str,
)
def test_a_run_starts_at_its_time(options):
    """It is the run from 0 if the sphere's motion is shifted by the same time."""
    start, duration = 0.3125, 0.25
    x = SCENE.initial_position
    ball = cs.Sphere(
        motion=cs.Linear((0.0, 2.0, 0.0)),
        center=(0.5, -0.55, 0.5),
        radius=0.25,
        response="ray" if "dt" in options else "penalty",
        offset="edge",
    )
    scene_from_0 = SCENE.replace(spheres=ball)
    center = ball.center - start * np.array([0, 2, 0])
    scene = SCENE.replace(spheres=ball.replace(center=tuple(center)))
    run_from_0 = cs.simulate(scene_from_0, duration, every=0.05, **options)
    run = cs.simulate(scene, duration, every=0.05, t=start, **options)
    assert run.t[0] == start and run.t[-1] == start + duration
    np.testing.assert_allclose(run.t, run_from_0.t + start, rtol=1e-15)
    assert abs(run_from_0.x[-1] - x).max() > 0.1
    # A contact magnifies the rounding of the clock. With the sphere at t = 0 this would be 0.2 m.
    assert abs(run.x - run_from_0.x).max() < 1e-7
    assert run.report["steps"] == run_from_0.report["steps"]
    depth, expected = (r.report["penetration"]["points"] for r in (run, run_from_0))
    assert abs(depth - expected) < 1e-7


@pytest.mark.parametrize("duration, dt", [(0.3, 0.1), (0.7, 0.1), (1.0, 1 / 3), (0.05, 5e-4)])
@pytest.mark.parametrize("start", [0.0, 1e6 / 7, -3.3])
def test_rounding_makes_no_extra_step_at_any_start(duration, dt, start):
    scene = cs.scenes.oscillator(stiffness=1.0)
    run = cs.simulate(scene, duration, dt=dt, t=start, every=dt)
    assert run.report["steps"] == round(duration / dt) == len(run.t) - 1
    assert run.t[-1] == start + duration


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"rtol": 1e-3, "integrator": "dop853"}], ids=str)
def test_the_callback_sees_every_frame(options, same_bits):
    calls = []

    def callback(t, x, v):
        assert not (x.flags.writeable or v.flags.writeable)
        calls.append((t, x, v))

    run = cs.simulate(SMALL, 0.1, fps=50, callback=callback, **options)
    # Error control repeats the run on a finer grid, and the calls begin again.
    assert len(calls) == len(run.t) * (1 if "dt" in options else 2)
    calls = calls[: len(run.t)]
    assert [t for t, _, _ in calls] == run.t.tolist()
    assert same_bits([x for _, x, _ in calls], run.x) and same_bits([v for _, _, v in calls], run.v)
    assert run.report["stopped"] == ""
    assert same_bits([run.x], [cs.simulate(SMALL, 0.1, fps=50, **options).x])


@pytest.mark.parametrize(
    "options",
    [
        {"dt": 1e-3},
        {"rtol": 1e-3, "integrator": "dop853"},
        {"rtol": 1e-3},
        {},
        {"dt": 1e-3, "estimate_error": True},
    ],
    ids=str,
)
def test_the_callback_stops_the_run(options):
    run = cs.simulate(SMALL, 0.1, fps=50, callback=lambda t, x, v: np.bool_(t > 0.05), **options)
    # A fixed step that does not divide the time to the frame ends a little later, and its state is
    # the last one.
    assert run.t[:4].tolist() == [0.0, 0.02, 0.04, 0.06] and run.t[-1] <= 0.06 + run.report["dt"]
    assert run.report["stopped"] == "callback"
    assert run.report["error_estimate"]["reason"] == "the run ended early: callback"
    expected = cs.simulate(SMALL, 0.1, fps=50, **options)
    assert abs(run.x[:4] - expected.x[:4]).max() < 1e-4
    assert 0 < run.report["steps"] < expected.report["steps"]


@pytest.mark.parametrize("options", [{"dt": 5e-5}, {"rtol": 1e-6, "integrator": "dop853"}], ids=str)
def test_ctrl_c_returns_the_finished_steps(options, precision, same_bits):
    timer = threading.Timer(0.3, signal.raise_signal, (signal.SIGINT,))
    with pytest.raises(cs.RunInterrupted) as raised:
        cs.simulate(
            SCENE,
            1e3,
            every=2e3,
            threads=1,
            precision=precision,
            callback=lambda t, x, v: timer.start(),
            **options,
        )
    timer.join()
    run = raised.value.run
    assert run.report["stopped"] == "interrupted" and f"{run.t[-1]:g}" in str(raised.value)
    assert len(run.t) == 2 and run.t[0] == 0.0
    if "dt" in options:
        steps = run.report["steps"]
        assert abs(run.t[-1] - steps * 5e-5) < 1e-9
        x, v = SCENE.initial_position, SCENE.initial_velocity
        assert same_bits(
            frame(run, -1), cs.step(SCENE, x, v, 5e-5, steps, precision=precision, threads=1)
        )


@pytest.mark.parametrize("step", [{"dt": 5e-5}, {"tolerance": 1e-6}], ids=str)
def test_ctrl_c_between_frames_that_follow_each_other_quickly(step):
    options = Options("dopri5", "double", 1)
    job = Job([SMALL], False, 500.0, options, frames=Frames(every=5e-3), **step)
    recording = Recording(job, Watch())
    timer = threading.Timer(0.3, signal.raise_signal, (signal.SIGINT,))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        recording.run_to_end()
    timer.join()
    assert len(recording.trajectory().t) < 100_000  # The whole run has more frames.


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_an_unstable_run_is_handed_over():
    cloth = cs.Cloth((9, 20), stiffness=900.0, damping=0.0, mass=18.0)
    scene = cs.Scene(cloth, gravity=(0.0, -1.0, 0.3))
    dt = 1.4 * cs.max_stable_dt(scene)
    with pytest.raises(cs.UnstableError) as raised:
        cs.simulate(scene, 5000 * dt, dt=dt, every=5)
    error = raised.value
    run = error.run
    assert run.report["stopped"] == "unstable"
    assert run.report["steps"] == error.step - 1 and error.step > 10
    np.testing.assert_array_equal(run.x[-1], error.x)
    np.testing.assert_array_equal(run.v[-1], error.v)
    np.testing.assert_allclose([run.t[-1] + dt, error.time], error.step * dt, rtol=1e-12)
    assert cs.UnstableError(step=1, time=0.1, dt=0.1).run is None


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"rtol": 1e-6}], ids=str)
@pytest.mark.parametrize("name", ["force", "callback"])
def test_an_error_of_a_users_function_carries_the_run(name, options):
    def function(t, x, v):
        if t > 0.045:
            raise KeyError("sensor")
        return 0 * x if name == "force" else None

    with pytest.raises(KeyError, match="sensor") as caught:
        cs.simulate(cs.scenes.oscillator(), 0.1, fps=100, **{name: function}, **options)
    run = caught.value.run
    assert run.report["stopped"] == "error"
    # A force is asked within steps, one of which is the whole run of a tolerance.
    if name == "callback":
        assert run.t[-1] >= 0.05 and len(run) > 5
    else:
        assert run.t[-1] == pytest.approx(0.045 if "dt" in options else 0.0)
    assert "stopped early (error)" in repr(run)
    with pytest.raises(TypeError, match="callback must return True") as caught:
        cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3, callback=lambda t, x, v: 1)
    assert len(caught.value.run) == 1
