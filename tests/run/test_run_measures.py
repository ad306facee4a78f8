"""Measures over frames, spheres at the time of a state, and what is shown of a run."""

import io
from contextlib import redirect_stdout

import clothsim as cs
import numpy as np
import pytest

MOVING = cs.Sphere((0.5, -0.3, 0.5), 0.25, cs.Linear((0.0, 0.5, 0.1)), "reflect", "none")
STILL = cs.Sphere((0.3, -0.2, 0.2), 0.1, None, "reflect", "none")
SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0), [MOVING, STILL])
X, V = SCENE.initial_position, SCENE.initial_velocity

pytestmark = pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")


@pytest.fixture(scope="module")
def run():
    return cs.simulate(SCENE, 0.6, t=0.1, dt=1e-3, fps=40)


# Time where a sphere moves


def test_penetration_at_the_times_of_a_batch():
    """The level sheet is below the top of the sphere by as much as the sphere has risen."""
    sphere = cs.Sphere(
        (0.5, -1.0, 0.5), 1.0, cs.Linear((0.0, 0.5, 0.0)), response="ray", offset="edge"
    )
    cloth = cs.Cloth((5, 5))
    times = np.array([0.0, 0.1, 0.4])
    x = np.stack([cloth.rest_positions] * 3)
    depths = cs.penetration(x, sphere, times)
    for name in ("points", "triangles"):
        np.testing.assert_allclose(depths[name], 0.5 * times, rtol=1e-12)
        np.testing.assert_allclose(cs.penetration(x, sphere, 0.4)[name], [0.2] * 3)
        assert cs.penetration(x[0], sphere, np.float64(0.1))[name] == depths[name][1]
    still = sphere.replace(motion=None)
    assert cs.penetration(x[0], still) == cs.penetration(x[0], still, 0.0)
    np.testing.assert_array_equal(cs.penetration(x, still, times)["points"], 0.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda scene, **t: cs.step(scene, X, V, 1e-3, **t),
        lambda scene, **t: cs.step([scene], X[None], V[None], 1e-3, **t),
        lambda scene, **t: cs.reference_step(scene, X, V, 1e-3, **t),
        lambda scene, **t: cs.Stepper(scene, X, **t),
        lambda scene, **t: cs.Stepper(scene, X, V, **t),
    ],
)
def test_time_is_required_where_a_sphere_moves(call):
    with pytest.raises(ValueError, match=r"t must be given.*spheres\[0\] has a motion.*t=0.0"):
        call(SCENE)
    call(SCENE, t=0.0)
    call(SCENE.replace(spheres=STILL))


# Over frames


def test_penetration_of_frames_is_at_their_times(run):
    depths = run.penetration()
    for name in ("points", "triangles"):
        each = [
            [cs.penetration(x, s, t)[name] for x, t in zip(run.x, run.t)] for s in SCENE.spheres
        ]
        np.testing.assert_array_equal(depths[name], np.max(each, axis=0))
        for k in range(2):
            np.testing.assert_array_equal(run.penetration(k)[name], each[k])
        assert depths[name].max() > 1e-4
        # The sphere where it was at the start would be another depth.
        assert abs(cs.penetration(run.x, MOVING, run.t[0])[name] - each[0]).max() > 0.01
    assert depths["points"].shape == (len(run.t),)


def test_energy_and_stretch_of_frames(run):
    energies, stretches = run.energy(), run.stretch()
    assert set(energies) == {"kinetic", "elastic", "gravity", "force", "contact", "total"}
    assert set(stretches) == {"largest"}
    for k in range(len(run.t)):
        alone = cs.energy(SCENE, run.x[k], run.v[k])
        assert {name: values[k] for name, values in energies.items()} == alone
        assert stretches["largest"][k] == cs.largest_stretch(SCENE, run.x[k])
    assert energies["total"][-1] == run.report["energy"]["end"]["total"]


# Shown and compared


def printed(thing):
    with redirect_stdout(io.StringIO()) as out:
        print(thing)
    return out.getvalue().splitlines()


def test_a_run_is_six_short_lines(run):
    lines = printed(run)
    assert len(lines) == 6 and max(map(len, lines)) < 100 and repr(run) == str(run)
    text = "\n".join(lines)
    assert "array" not in text
    for part in (
        "6 x 7 mass points",
        "2 spheres",
        "25 frames from t = 0.1 to 0.7 s",
        "600 steps of 0.001 s",
        "rk4 in double",
        "steps/s",
    ):
        assert part in text
    report = run.report
    change = report["energy"]["end"]["total"] - report["energy"]["start"]["total"]
    assert f"(change, by damping, contact and forces, {change:.4g} J)" in text
    assert f"points {report['penetration']['points']:.4g} m" in text
    free = SCENE.replace(spheres=())
    mean = repr(cs.simulate(free, 0.6, rtol=1e-4, integrator="dopri5")).splitlines()[2]
    assert "steps of about 0.0" in mean and "dopri5 in double" in mean
    stopped = cs.simulate(SCENE, 0.6, dt=1e-3, callback=lambda t, x, v: True)
    assert "stopped early (callback)" in repr(stopped)
    assert stopped.t.tolist() == [0.0] and stopped.report["steps"] == 0


@pytest.mark.parametrize("as_printed", [False, True])
def test_a_run_says_whether_it_is_as_printed_in_the_paper(as_printed):
    run = cs.simulate(cs.scenes.paper_moving("reflect", as_printed=as_printed), 0.01, dt=1e-3)
    assert ("response reflect as printed" in str(run)) is as_printed is run.report["as_printed"]


def test_runs_are_equal_if_their_results_are(run, tmp_path):
    again = cs.simulate(SCENE, 0.6, t=0.1, dt=1e-3, fps=40)
    assert run == run and run == again and hash(run) == hash(again)
    assert run == cs.load_run(run.save(tmp_path / "run")) and len({run, again}) == 1
    other = cs.simulate(SCENE, 0.6, dt=1e-3, fps=40)
    assert run != other and run != 3
    assert run != cs.simulate(SCENE.replace(spheres=MOVING), 0.6, t=0.1, dt=1e-3, fps=40)
    one = cs.Stepper(SCENE).snapshot()
    assert one == one and one != cs.Stepper(SCENE).snapshot() and len({one}) == 1


def test_frames_of_a_users_own_print():
    scene = cs.scenes.oscillator()
    x = np.stack([scene.initial_position] * 2)
    for report in ({}, {"source": "a camera"}):
        lines = repr(cs.Run(scene, np.array([0.0, 1.0]), x, 0 * x, report)).splitlines()
        assert len(lines) == 2 and lines[1] == "2 frames from t = 0 to 1 s"
