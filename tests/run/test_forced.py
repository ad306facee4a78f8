"""`simulate(force=f)`: a force of a function, held from frame to frame, and its work."""

import clothsim as cs
import numpy as np
import pytest

CLOTH = cs.Cloth((6, 7), mass=2.0, stiffness=200.0, damping=0.0)
SCENE = cs.Scene(CLOTH, force=np.full((6, 7, 3), 0.01))
GUST = np.random.default_rng(1).normal(scale=0.1, size=(6, 7, 3))


def wind(t, x, v):
    """A wind that starts at 0.1 s and is less against what flies with it."""
    assert not x.flags.writeable
    return (t > 0.0999) * (GUST - 0.02 * v)


def by_hand(dt, steps, frames):
    stepper = cs.Stepper(SCENE)
    for _ in range(frames):
        stepper.set_force(wind(stepper.t, frozen(stepper.x), stepper.v) + SCENE.force)
        stepper.advance(steps, dt)
    return stepper


def frozen(x):
    x.flags.writeable = False
    return x


def test_it_is_that_of_a_stepper_that_sets_the_force(same_bits):
    run = cs.simulate(SCENE, 0.4, dt=1e-3, fps=50, force=wind)
    stepper = by_hand(1e-3, 20, 20)
    assert same_bits([run.x[-1], run.v[-1]], [stepper.x, stepper.v])
    assert run.scene == SCENE and run.report["steps"] == 400
    assert abs(run.x[-1] - cs.simulate(SCENE, 0.4, dt=1e-3).x[-1]).max() > 0.01


def test_steps_end_where_the_force_changes():
    run = cs.simulate(SCENE, 0.3, dt=3e-3, fps=10, force=wind)
    assert run.report["steps"] == 3 * 34
    small = cs.simulate(SCENE, 0.3, dt=1e-3, fps=10, force=wind)
    assert abs(run.x - small.x).max() < 1e-5


@pytest.mark.parametrize(
    "options",
    [{"rtol": 1e-9}, {"rtol": 1e-7, "integrator": "rk4"}, {"dt": 1e-3, "estimate_error": True}],
)
def test_error_control_and_estimates_see_the_force(options):
    run = cs.simulate(SCENE, 0.4, fps=50, force=wind, **options)
    estimate = run.report["error_estimate"]
    error = np.sqrt(((run.x[-1] - by_hand(1e-4, 200, 20).x) ** 2).sum(axis=-1).mean())
    assert estimate["reason"] == "" and estimate["rms"] <= max(options.get("rtol", 0), 1e-7)
    assert error <= max(2 * estimate["rms"], 1e-9)


def test_its_work_is_the_energy_that_it_brings():
    run = cs.simulate(SCENE, 0.6, rtol=1e-8, fps=50, force=wind)
    total = run.energy()["total"]
    work = run.report["force_work"]
    assert abs(work) > 0.01 and work == pytest.approx(total[-1] - total[0], rel=1e-4)
    assert cs.simulate(SCENE, 0.1, dt=1e-3).report["force_work"] == 0.0


def test_a_run_with_a_force_goes_on_with_one(same_bits, tmp_path):
    whole = cs.simulate(SCENE, 0.4, dt=1e-3, fps=50, force=wind)
    first = cs.simulate(SCENE, 0.2, dt=1e-3, fps=50, force=wind)
    with pytest.raises(ValueError, match="force must be given"):
        cs.load_run(first.save(tmp_path / "run")).resume(0.2)
    both = first + first.resume(0.2, force=wind)
    assert same_bits([both.t, both.x, both.v], [whole.t, whole.x, whole.v])
    assert both.report["force_work"] == pytest.approx(whole.report["force_work"], rel=1e-12)


@pytest.mark.parametrize(
    "options, error, words",
    [
        ({"force": lambda t, x, v: x[0]}, ValueError, r"force\(t, x, v\) must be .*\(6, 7, 3\)"),
        ({"force": lambda t, x, v: x * np.nan}, ValueError, "finite"),
        ({"force": wind, "every": 5, "dt": None}, ValueError, "frames that are counted in steps"),
        ({"force": wind, "backend": "gpu"}, ValueError, "backend 'gpu'"),
    ],
)
def test_refused(options, error, words):
    with pytest.raises(error, match=words):
        cs.simulate(SCENE, 0.1, **{"dt": 1e-3, **options})


@pytest.mark.parametrize("name, instead", [("wind", "force="), ("air", "drag=")])
def test_other_names_for_it_are_hinted_at(name, instead):
    with pytest.raises(TypeError, match=f"unknown argument '{name}'.*{instead}"):
        cs.simulate(SCENE, 0.1, **{name: 1.0})


def test_a_sequence_of_scenes_takes_a_force(same_bits):
    scenes = [SCENE, SCENE.replace(gravity=(0, -3, 0))]
    for run, scene in zip(
        cs.simulate(scenes, 0.2, dt=1e-3, fps=50, force=wind), scenes, strict=True
    ):
        assert run == cs.simulate(scene, 0.2, dt=1e-3, fps=50, force=wind)


# A run and its continuation


@pytest.mark.parametrize("response", ["ray", "penalty"])
def test_a_run_and_its_continuation_are_the_whole_run(response):
    ball = cs.Sphere(
        (0.5, -0.3, 0.5),
        0.25,
        cs.Linear((0.0, 0.5, 0.1)),
        friction=0.1,
        response=response,
        offset="edge",
    )
    scene = cs.Scene(CLOTH.replace(damping=0.1), ball)
    whole, first = (cs.simulate(scene, duration, dt=5e-4, fps=50) for duration in (0.8, 0.4))
    both = first + first.resume(0.4)
    assert both == whole and both.resume(0.1) == whole.resume(0.1)
    for name in ("steps", "force_evaluations", "first_contact", "dt", "stopped", "version"):
        assert both.report[name] == whole.report[name]
    depth, expected = both.report["penetration"], whole.report["penetration"]
    assert depth["points"] == expected["points"] and depth["triangles"] == pytest.approx(
        expected["triangles"], rel=0.1
    )
    for name in ("impulse", "obstacle_work"):
        np.testing.assert_allclose(both.report[name], whole.report[name], rtol=1e-9)
    assert (whole.report["obstacle_work"][0] > 0) == (response == "penalty")
    assert both.report["energy"]["end"] == whole.report["energy"]["end"]
    assert both.report.keys() == whole.report.keys()
    early = cs.simulate(scene, 0.02, dt=5e-4, fps=50)
    assert (early + early.resume(0.78)).report["first_contact"] == whole.report["first_contact"]


def test_only_a_continuation_can_be_added():
    run = cs.simulate(SCENE, 0.1, dt=1e-3)
    for other in (run, cs.simulate(SCENE.replace(gravity=(0, 0, 0)), 0.1, dt=1e-3)):
        with pytest.raises(ValueError, match="goes on from the last frame"):
            run + other
    with pytest.raises(TypeError):
        run + 3
