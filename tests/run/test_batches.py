"""`simulate` of many scenes: each run is that of its scene alone."""

import clothsim as cs
import numpy as np
import pytest

BALL = cs.Sphere((0.5, -0.3, 0.5), 0.2, restitution=0.5, response="ray", offset="edge")
LOOSE = cs.Scene(cs.Cloth((6, 7), mass=1.0, damping=0.2, springs=("structural", "shear")))
TIMES = ("wall_time", "steps_per_second", "threads")


def scenes(*stiffness):
    """Make scenes with no sphere, one, two and so on, the first of which moves."""
    balls = [BALL.replace(center=(0.5, -0.55, 0.5), motion=cs.Linear((0.0, 0.5, 0.0))), *[BALL] * 5]
    return [
        LOOSE.replace(cloth=LOOSE.cloth.replace(stiffness=s), spheres=balls[:k])
        for k, s in enumerate(stiffness)
    ]


def same_report(a, b):
    return all(repr(a.report[key]) == repr(b.report[key]) for key in a.report if key not in TIMES)


@pytest.mark.parametrize(
    "options",
    [
        {"dt": 2e-3, "every": 1.3e-3},
        {"dt": 1e-3, "every": 1, "t": 2.0},
        {"dt": 7e-4, "kernel": "gather", "times": [0.101, 0.3]},
        {"dt": 1e-3, "estimate_error": True},
        {"rtol": 1e-4},
        {},
    ],
    ids=str,
)
def test_each_run_is_that_of_its_scene_alone(options, precision):
    batch = scenes(150.0, 200.0, 250.0)
    if "dt" in options:
        options = {"precision": precision, **options}
    runs = cs.simulate(batch, 0.4, **options)
    assert len(runs) == 3
    for scene, run in zip(batch, runs, strict=True):
        expected = cs.simulate(scene, 0.4, **options)
        assert run == expected and run.scene is scene and same_report(run, expected)
        steppers = [cs.Stepper.restore(side.snapshot) for side in (run, expected)]
        assert np.array_equal(steppers[0].impulses, steppers[1].impulses)
        # A schedule of times has none after the end.
        if "times" not in options:
            assert run.resume(0.1) == expected.resume(0.1)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize(
    "options", [{}, {"callback": lambda *state: None}], ids=["batch", "one by one"]
)
def test_a_member_that_diverges_leaves_the_others(options, precision):
    batch = scenes(1e2, 5e3, 2e2, 3e5)
    options = {"dt": 3e-3, "precision": precision, "every": 0.01, **options}
    with pytest.raises(cs.UnstableError, match="of batch member 1") as caught:
        cs.simulate(batch, 0.5, **options)
    assert caught.value.member == 1 and caught.value.run is caught.value.runs[1]
    assert caught.value.step == caught.value.run.report["steps"] + 1 > 5
    stopped = []
    for scene, run in zip(batch, caught.value.runs, strict=True):
        try:
            expected = cs.simulate(scene, 0.5, **options)
        except cs.UnstableError as error:
            expected = error.run
        assert run == expected and same_report(run, expected)
        stopped.append(run.report["stopped"])
    assert stopped == ["", "unstable", "", "unstable"]


def test_a_point_that_goes_through_a_layer_ends_its_member_alone(leak):
    batch = [leak(1.0), leak(0.1)]
    with pytest.raises(cs.ContactError) as caught:
        cs.simulate(batch, 0.3, dt=1e-3)
    failed, second = caught.value.runs
    assert failed.report["stopped"] == "contact"
    assert failed.report["steps"] == caught.value.step - 1
    assert second == cs.simulate(batch[1], 0.3, dt=1e-3)


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"rtol": 1e-3}], ids=str)
def test_ctrl_c_returns_the_runs_so_far(options):
    def interrupt(t, x, v):
        if t > 0.05:
            raise KeyboardInterrupt
        return 0 * x

    with pytest.raises(cs.RunInterrupted) as caught:
        cs.simulate(scenes(150.0, 200.0), 0.1, every=0.01, force=interrupt, **options)
    assert [run.report["stopped"] for run in caught.value.run][-1] == "interrupted"
    assert len(caught.value.run) == (2 if "dt" in options else 1)
    assert all(0 < run.t[-1] < 0.1 for run in caught.value.run)


def test_measures_of_many_scenes_are_those_of_each_alone():
    batch = scenes(150.0, 200.0, 250.0)
    x = np.array([scene.initial_position * (1.1 + 0.1 * k) for k, scene in enumerate(batch)])
    members = list(zip(batch, x, strict=True))
    for name, values in cs.energy(batch, x, 0 * x).items():
        assert values.tolist() == [cs.energy(scene, y, 0 * y)[name] for scene, y in members]
    assert cs.max_stable_dt(batch).tolist() == list(map(cs.max_stable_dt, batch))
    limits = cs.max_stable_dt(batch, "velocity_verlet", x)
    assert limits.tolist() == [
        cs.max_stable_dt(scene, "velocity_verlet", y) for scene, y in members
    ]
    for run, scene in zip(cs.settle(batch, 1e-3), batch, strict=True):
        assert run == cs.settle(scene, 1e-3)
    with pytest.raises(ValueError, match=r"x must be an array of shape \(3, 6, 7, 3\)"):
        cs.max_stable_dt(batch, x=x[:2])


@pytest.mark.parametrize(
    "call",
    [cs.max_stable_dt, cs.settle, lambda s: cs.energy(s, 0, 0), lambda s: cs.simulate(s, 0.1)],
)
def test_scenes_of_different_shapes_are_refused(call):
    with pytest.raises(
        ValueError, match="scene must be a Scene or a non-empty sequence of Scene of one shape"
    ):
        call([LOOSE, cs.scenes.oscillator()])
