"""Measures over frames, spheres at the time of a state, and the print of a run."""

import io
import re
import warnings
from contextlib import redirect_stdout

import clothsim as cs
import numpy as np
import pytest
from clothsim.run.reasons import Reason

MOVING = cs.Sphere((0.5, -0.3, 0.5), 0.25, cs.Linear((0.0, 0.5, 0.1)), "reflect", "none")
STILL = cs.Sphere((0.3, -0.2, 0.2), 0.1, None, "reflect", "none")
SCENE = cs.Scene(cs.Cloth((6, 7), mass=21.0), [MOVING, STILL])
X, V = SCENE.initial_position, SCENE.initial_velocity

pytestmark = pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")


@pytest.fixture(scope="module")
def run():
    return cs.simulate(SCENE, 0.6, t=0.1, dt=1e-3, fps=40)


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
    sphere_at_rest = sphere.replace(motion=None)
    assert cs.penetration(x[0], sphere_at_rest) == cs.penetration(x[0], sphere_at_rest, 0.0)
    np.testing.assert_array_equal(cs.penetration(x, sphere_at_rest, times)["points"], 0.0)


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


def test_penetration_of_frames_is_at_their_times(run):
    depths = run.penetration()
    for name in ("points", "triangles"):
        depths_of_spheres = [
            [cs.penetration(x, s, t)[name] for x, t in zip(run.x, run.t)] for s in SCENE.spheres
        ]
        np.testing.assert_array_equal(depths[name], np.max(depths_of_spheres, axis=0))
        for k in range(2):
            np.testing.assert_array_equal(run.penetration(k)[name], depths_of_spheres[k])
        assert depths[name].max() > 1e-4
        # At the start the sphere was elsewhere, which would be another depth.
        assert (
            abs(cs.penetration(run.x, MOVING, run.t[0])[name] - depths_of_spheres[0]).max() > 0.01
        )
    assert depths["points"].shape == (len(run.t),)


def test_energy_and_stretch_of_frames(run):
    energies = run.energy()
    stretches = run.stretch()
    assert set(energies) == {"kinetic", "elastic", "gravity", "force", "contact", "total"}
    assert set(stretches) == {"largest"}
    for k in range(len(run.t)):
        expected = cs.energy(SCENE, run.x[k], run.v[k])
        assert {name: values[k] for name, values in energies.items()} == expected
        assert stretches["largest"][k] == cs.largest_stretch(SCENE, run.x[k])
    assert energies["total"][-1] == run.report["energy"]["end"]["total"]


def printed_lines(thing):
    with redirect_stdout(io.StringIO()) as out:
        print(thing)
    return out.getvalue().splitlines()


def test_a_run_is_seven_short_lines(run):
    lines = printed_lines(run)
    assert len(lines) == 7 and max(map(len, lines)) < 110 and repr(run) == str(run)
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
    assert lines[-1] == f"error not known: {Reason.NOT_ASKED}"
    assert f"points {report['penetration']['points']:.4g} m" in text
    free = SCENE.replace(spheres=())
    mean = repr(cs.simulate(free, 0.6, rtol=1e-4, integrator="dopri5")).splitlines()[2]
    assert "steps of about 0.0" in mean and "dopri5 in double" in mean
    stopped = cs.simulate(SCENE, 0.6, dt=1e-3, callback=lambda t, x, v: True)
    assert "stopped early (callback)" in repr(stopped)
    assert stopped.t.tolist() == [0.0] and stopped.report["steps"] == 0


CHANGES = {
    "the method": cs.Scene(cs.Cloth((6, 7), mass=1.0, stiffness=100.0, damping=0.0)),
    "damping and the method": cs.Scene(cs.Cloth((6, 7), mass=1.0, stiffness=100.0, damping=0.1)),
    "driven pins and the method": cs.Scene(
        cs.Cloth(
            (6, 7), mass=1.0, stiffness=100.0, damping=0.0, pins={(0, 0): cs.Linear((0, 0.1, 0))}
        )
    ),
}


@pytest.mark.parametrize("cause", CHANGES)
def test_the_change_of_energy_is_told_by_cause(cause):
    run = cs.simulate(CHANGES[cause], 0.2, dt=1e-3)
    change = run.report["energy"]["end"]["total"] - run.report["energy"]["start"]["total"]
    assert printed_lines(run)[3].endswith(f" at the end: {change:.4g} J by {cause}")


def test_works_that_are_known_leave_the_rest_to_the_method():
    scene = CHANGES["the method"].replace(wind=cs.Wind((3, 0, 0)))
    run = cs.simulate(scene, 0.2, rtol=1e-8, force=lambda t, x, v: 0 * x + (0, 1e-3, 0))
    line = printed_lines(run)[3]
    parts = re.findall(r"([-+.e\d]+) J by ([a-z ]+)", line)
    assert [cause for _, cause in parts] == ["force", "wind", "the method"]
    works = [float(work) for work, _ in parts]
    assert works[0] == pytest.approx(run.report["force_work"], rel=1e-3)
    assert works[1] == pytest.approx(run.report["wind_work"], rel=1e-3)
    assert abs(works[2]) < 1e-6 * abs(works[1])


def test_the_work_of_a_moving_obstacle_is_told_and_leaves_nothing():
    """A ball lifts an undamped sheet by an elastic layer: all energy is that of its motion."""
    ball = cs.Sphere((0.5, -0.3, 0.5), 0.25, cs.Linear((0, 1.0, 0)), dissipation=0)
    scene = CHANGES["the method"].replace(spheres=ball)
    run = cs.simulate(scene, 0.3, rtol=1e-9)
    line = printed_lines(run)[3]
    work, rest = re.findall(
        r": ([-+.e\d]+) J by moving obstacles, ([-+.e\d]+) J by the method", line
    )[0]
    assert float(work) == pytest.approx(run.report["obstacle_work"][0], rel=1e-3)
    assert float(work) > 1e-3 and abs(float(rest)) < 1e-6 * float(work)


def test_a_run_ends_with_its_error():
    scene = CHANGES["the method"]
    run = cs.simulate(scene, 0.2, rtol=1e-6)
    error = run.report["error_estimate"]["rms"]
    assert printed_lines(run)[-1] == f"error at the end about {error:.2g} m (asked 1e-06)"
    run = cs.simulate(scene, 0.2, dt=1e-3, estimate_error=True)
    error = run.report["error_estimate"]["rms"]
    assert printed_lines(run)[-1] == f"error at the end about {error:.2g} m"
    with pytest.warns(cs.ToleranceWarning, match="above the one that was asked for: "):
        run = cs.simulate(scene, 0.2, rtol=1e-17)
    assert "(asked 1e-17, not reached: " in printed_lines(run)[-1]
    contact = cs.scenes.paper_static()
    with pytest.warns(cs.ToleranceWarning, match="not known: an obstacle responded"):
        run = cs.simulate(contact, 0.5, rtol=1e-6)
    assert printed_lines(run)[-1] == f"error not known: {Reason.CONTACT}"
    with warnings.catch_warnings():
        warnings.simplefilter("error", cs.ToleranceWarning)
        assert printed_lines(cs.simulate(contact, 0.5))[-1] == f"error not known: {Reason.CONTACT}"


@pytest.mark.parametrize("as_printed", [False, True])
def test_a_run_says_whether_it_is_as_printed_in_the_paper(as_printed):
    run = cs.simulate(cs.scenes.paper_moving("reflect", as_printed=as_printed), 0.01, dt=1e-3)
    assert ("response reflect as printed" in str(run)) is as_printed is run.report["as_printed"]


def test_runs_are_equal_if_their_results_are(run, tmp_path):
    second = cs.simulate(SCENE, 0.6, t=0.1, dt=1e-3, fps=40)
    assert run == run and run == second and hash(run) == hash(second)
    assert run == cs.load_run(run.save(tmp_path / "run")) and len({run, second}) == 1
    other = cs.simulate(SCENE, 0.6, dt=1e-3, fps=40)
    assert run != other and run != 3
    assert run != cs.simulate(SCENE.replace(spheres=MOVING), 0.6, t=0.1, dt=1e-3, fps=40)
    snapshot = cs.Stepper(SCENE).snapshot()
    assert (
        snapshot == snapshot and snapshot != cs.Stepper(SCENE).snapshot() and len({snapshot}) == 1
    )


def test_frames_of_a_users_own_print():
    scene = cs.scenes.oscillator()
    x = np.stack([scene.initial_position] * 2)
    for report in ({}, {"source": "a camera"}):
        lines = repr(cs.Run(scene, np.array([0.0, 1.0]), x, 0 * x, report)).splitlines()
        assert len(lines) == 2 and lines[1] == "2 frames from t = 0 to 1 s"
