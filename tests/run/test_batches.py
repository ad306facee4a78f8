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
    given = scenes(150.0, 200.0, 250.0)
    runs = cs.simulate(
        given, 0.4, **{"precision": precision, **options} if "dt" in options else options
    )
    assert len(runs) == 3
    for scene, run in zip(given, runs, strict=True):
        alone = cs.simulate(
            scene, 0.4, **{"precision": precision, **options} if "dt" in options else options
        )
        assert run == alone and run.scene is scene and same_report(run, alone)
        impulses = [cs.Stepper.restore(one.snapshot).impulses for one in (run, alone)]
        assert np.array_equal(*impulses)
        if "kernel" not in options:  # whose schedule has times before the end alone
            assert run.resume(0.1) == alone.resume(0.1)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize(
    "options", [{}, {"callback": lambda *state: None}], ids=["batch", "one by one"]
)
def test_a_member_that_diverges_leaves_the_others(options, precision):
    given = scenes(1e2, 5e3, 2e2, 3e5)
    options = {"dt": 3e-3, "precision": precision, "every": 0.01, **options}
    with pytest.raises(cs.UnstableError, match="of batch member 1") as caught:
        cs.simulate(given, 0.5, **options)
    assert caught.value.member == 1 and caught.value.run is caught.value.runs[1]
    assert caught.value.step == caught.value.run.report["steps"] + 1 > 5
    stopped = []
    for scene, run in zip(given, caught.value.runs, strict=True):
        try:
            alone = cs.simulate(scene, 0.5, **options)
        except cs.UnstableError as error:
            alone = error.run
        assert run == alone and same_report(run, alone)
        stopped.append(run.report["stopped"])
    assert stopped == ["", "unstable", "", "unstable"]


def test_a_point_that_goes_through_a_layer_ends_its_member_alone(leak):
    given = [leak(1.0), leak(0.1)]
    with pytest.raises(cs.ContactError) as caught:
        cs.simulate(given, 0.3, dt=1e-3)
    failed, whole = caught.value.runs
    assert failed.report["stopped"] == "contact"
    assert failed.report["steps"] == caught.value.step - 1
    assert whole == cs.simulate(given[1], 0.3, dt=1e-3)


@pytest.mark.parametrize("options", [{"dt": 1e-3}, {"rtol": 1e-3}], ids=str)
def test_ctrl_c_returns_the_runs_so_far(monkeypatch, options):
    from clothsim.run import trajectory

    calls = []

    def interrupt(self, t):
        calls.append(t)
        if len(calls) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(trajectory.Recorder, "_passed", interrupt)
    with pytest.raises(cs.RunInterrupted) as caught:
        cs.simulate(scenes(150.0, 200.0), 0.1, every=0.01, **options)
    assert [run.report["stopped"] for run in caught.value.run][-1] == "interrupted"
    assert len(caught.value.run) == (2 if "dt" in options else 1)
    assert all(0 < run.t[-1] < 0.1 for run in caught.value.run)


def test_measures_of_many_scenes_are_those_of_each_alone():
    given = scenes(150.0, 200.0, 250.0)
    x = np.array([one.initial_position * (1.1 + 0.1 * k) for k, one in enumerate(given)])
    for name, values in cs.energy(given, x, 0 * x).items():
        assert values.tolist() == [
            cs.energy(one, each, 0 * each)[name] for one, each in zip(given, x, strict=True)
        ]
    assert cs.max_stable_dt(given).tolist() == list(map(cs.max_stable_dt, given))
    at = cs.max_stable_dt(given, "velocity_verlet", x)
    assert at.tolist() == [
        cs.max_stable_dt(one, "velocity_verlet", each) for one, each in zip(given, x, strict=True)
    ]
    for run, one in zip(cs.settle(given, 1e-3), given, strict=True):
        assert run == cs.settle(one, 1e-3)
    with pytest.raises(ValueError, match=r"x must be an array of shape \(3, 6, 7, 3\)"):
        cs.max_stable_dt(given, x=x[:2])


@pytest.mark.parametrize(
    "call",
    [cs.max_stable_dt, cs.settle, lambda s: cs.energy(s, 0, 0), lambda s: cs.simulate(s, 0.1)],
)
def test_scenes_of_different_shapes_are_refused(call):
    with pytest.raises(
        ValueError, match="scene must be a Scene or a non-empty sequence of Scene of one shape"
    ):
        call([LOOSE, cs.scenes.oscillator()])
