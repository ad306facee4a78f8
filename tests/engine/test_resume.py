"""A run that goes on, snapshots in files, and a stepper whose state and scene are changed."""

import json
import pickle

import clothsim as cs
import numpy as np
import pytest
from clothsim.base import files
from variants import FIXED

SCENE = cs.scenes.paper_swing()
CLOTH = SCENE.cloth.replace(shape=(6, 7), mass=21.0)
BALL = cs.Sphere(
    (0.5, -0.3, 0.5), 0.25, cs.Linear((0.0, 0.5, 0.1)), friction=0.1, response="ray", offset="edge"
)
SMALL = cs.Scene(CLOTH, BALL)


def end(run):
    return run.x[-1], run.v[-1]


# Runs


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning")
@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", FIXED)
def test_a_resumed_run_equals_an_uninterrupted_run(integrator, precision, same_bits, tmp_path):
    options = {"dt": 1e-3, "integrator": integrator, "precision": precision, "threads": 1}
    uncut = cs.simulate(SMALL, 0.5, t=0.25, fps=50, **options)
    first = cs.simulate(SMALL, 0.3, t=0.25, fps=50, **options)
    assert cs.simulate(SMALL, 0.3, t=0.25, **options).report["penetration"] is not None
    for run in (
        first,
        cs.load_run(first.save(tmp_path / "first")),
        pickle.loads(pickle.dumps(first)),
    ):
        rest = run.resume(0.2)
        assert same_bits([rest.t, rest.x, rest.v], [a[15:] for a in (uncut.t, uncut.x, uncut.v)])
        assert rest.report["steps"] == 200
    thirds = first.resume(0.1).resume(0.1)
    assert same_bits(end(thirds), end(uncut)) and thirds.t[-1] == uncut.t[-1]
    # The contact was before and after the break, and the sphere went on from where it was.
    assert uncut.v[15].std() > 0.1
    back = cs.simulate(SMALL.replace(position=first.x[-1], velocity=first.v[-1]), 0.2, **options)
    assert abs(back.x[-1] - uncut.x[-1]).max() > 1e-3


def test_frames_go_on_in_their_grid(same_bits):
    for frames in ({"every": 7}, {"every": 0.007}, {"fps": 130}, {"every": 1}):
        uncut = cs.simulate(SMALL, 0.1, dt=1e-3, **frames)
        first = cs.simulate(SMALL, 0.05, dt=1e-3, **frames)
        rest = first.resume(0.05)
        expected = [t for t in uncut.t if t > 0.05 + 1e-9]
        assert rest.t[1:].tolist() == expected and rest.t[0] == first.t[-1]
    second = first.resume(0.05, times=[0.06, 0.0701])
    np.testing.assert_array_equal(second.t, [0.05, 0.06, 0.0701, 0.1])
    expected = cs.simulate(SMALL, 0.1, dt=1e-3, times=[0.05, 0.06, 0.0701])
    assert same_bits([second.x], [expected.x[1:]])


@pytest.mark.parametrize("scene", [SMALL.replace(spheres=()), SMALL], ids=["free", "contact"])
@pytest.mark.parametrize("integrator", ["dopri5", "dop853"])
def test_a_stopped_run_with_error_control_goes_on(scene, integrator, same_bits, tmp_path):
    """It stops at a step, in the middle of the work of its controller."""
    options = {"rtol": 1e-4, "integrator": integrator, "every": 2, "threads": 1}
    uncut = cs.simulate(scene, 0.5, **options)
    stops = []

    def stop(t, x, v):
        stops.append(t)
        return len(stops) == 4

    first = cs.simulate(scene, 0.5, callback=stop, **options)
    assert first.t.tolist() == stops[-4:] and first.report["steps"] == 6
    duration = 0.5 - first.t[-1]
    assert first.t[-1] + duration == 0.5
    for run in (first, cs.load_run(first.save(tmp_path / "first"))):
        rest = run.resume(duration)
        if uncut.report["steps"] == rest.report["steps"] + 6:
            assert same_bits([rest.t, rest.x, rest.v], [a[3:] for a in (uncut.t, uncut.x, uncut.v)])
        else:  # the whole run was repeated at a smaller tolerance
            assert uncut.report["force_evaluations"] > 2 * uncut.report["solution_evaluations"]
    assert rest.report["stopped"] == ""


# Snapshots


@pytest.mark.parametrize("batch", [False, True])
def test_a_snapshot_from_a_file_goes_on_with_the_same_bits(batch, precision, tmp_path, same_bits):
    scenes = [SMALL, SMALL.replace(gravity=(0.0, -3.0, 0.1))] if batch else SMALL
    stepper = cs.Stepper(scenes, precision=precision, threads=1)
    stepper.advance(300, 1e-3)
    if batch:
        stepper.freeze(1)
    snapshot = cs.Snapshot.load(stepper.snapshot().save(tmp_path / "state"))
    stepper.advance(200, 1e-3)
    # A snapshot is not used up.
    for copy in (snapshot, pickle.loads(pickle.dumps(snapshot)), snapshot):
        second = cs.Stepper.restore(copy)
        second.advance(steps=200, dt=1e-3)
        assert same_bits((second.x, second.v), (stepper.positions, stepper.velocities))
    assert second.time == second.t == stepper.time and second.scene == scenes
    np.testing.assert_array_equal(second.impulses, stepper.impulses)
    assert np.all(stepper.impulses.any(axis=-1))
    np.testing.assert_array_equal(second.frozen, stepper.frozen)
    assert f"{snapshot.time:g} s" in repr(snapshot) and len(repr(snapshot)) < 120


class Evil:
    def __reduce__(self):
        return print, ("executed",)


@pytest.mark.parametrize("load", [cs.load_run, cs.Snapshot.load])
def test_files_that_are_not_ours_are_refused(load, tmp_path, capsys):
    contents = {"text": b"time,x\n0,1\n", "empty": b"", "pickle": pickle.dumps(Evil())}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    np.savez(tmp_path / "other.npz", a=1)
    evil = np.array([Evil()], object)
    parts = {"x": 0, "v": 0, "scene": "{}", "snapshot_state": 0}
    np.savez(tmp_path / "evil.npz", t=evil, report="{}", snapshot=evil, **parts)
    np.savez(tmp_path / "wrong.npz", t=0, report="{", snapshot="[]", **parts)
    for name in (*contents, "other.npz", "evil.npz", "wrong.npz"):
        with pytest.raises(ValueError, match=f"{name} is no (run|snapshot) of clothsim: "):
            load(tmp_path / name)
    assert capsys.readouterr().out == ""
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nowhere.npz")


def test_a_file_of_another_schema_is_refused(tmp_path):
    path = cs.Stepper(SMALL).snapshot().save(tmp_path / "state")
    data = files.read_npz(path, "snapshot", ())
    header = json.loads(str(data["snapshot"]))
    files.write_npz(path, {**data, "snapshot": json.dumps({**header, "schema": 1})})
    with pytest.raises(ValueError, match="schema must be 5, got 1"):
        cs.Snapshot.load(path)


# Steppers


def test_set_state(precision, same_bits):
    free = SMALL.replace(spheres=())  # a clock set anew rounds differently, which a sphere shows
    stepper = cs.Stepper(free, precision=precision, threads=1)
    stepper.advance(150, 1e-3)
    x, v = stepper.positions, stepper.velocities
    fresh = cs.Stepper(free, precision=precision, threads=1)
    fresh.set_state(x, v, t=stepper.time)
    assert fresh.time == stepper.time
    for sheet in (stepper, fresh):
        sheet.advance(100, 1e-3)
    assert same_bits([fresh.positions], [stepper.positions])
    # What is not given stays, with the compensation of "single".
    single = cs.Stepper(
        SMALL, x.astype(np.float32), v.astype(np.float32), t=0.0, precision=precision, threads=1
    )
    single.advance(100, 1e-3)
    twin = cs.Stepper.restore(single.snapshot())
    single.set_state()
    single.advance(100, 1e-3)
    twin.advance(100, 1e-3)
    assert same_bits([single.positions], [twin.positions])


def test_set_state_moves_the_clock_of_the_spheres():
    still = SMALL.cloth.replace(stiffness=0.0, damping=0.0, pins=())
    stepper = cs.Stepper(cs.Scene(still, BALL, gravity=(0, 0, 0)))
    stepper.advance(50, 1e-3)
    assert not stepper.positions[..., 1].any()
    stepper.set_state(t=0.1)  # the sphere is about to touch the sheet from below
    stepper.advance(70, 1e-3)
    assert stepper.time == pytest.approx(0.17) and stepper.positions[..., 1].max() > 0.01


def test_set_scene_keeps_the_state(precision, same_bits):
    soft = SMALL.replace(cloth=CLOTH.replace(stiffness=20_000.0), gravity=(0.0, -3.0, 1.0))
    x, v = (a.astype(np.float32) for a in (SMALL.initial_position, SMALL.initial_velocity))
    stepper = cs.Stepper(SMALL, x, v, t=0.0, precision=precision, threads=1)
    stepper.advance(150, 1e-3)
    copy = cs.Stepper.restore(stepper.snapshot())
    copy.set_scene(soft)
    assert copy.scene == soft and copy.time == stepper.time
    assert same_bits([copy.positions], [stepper.positions])
    copy.advance(100, 1e-3)
    # float64 arrays hold the compensation, so `step` does the same from the state in float64.
    state = np.empty(x.shape), np.empty(x.shape)
    stepper._state.core.store(*state)
    expected = cs.step(soft, *state, 1e-3, 100, t=0.15, precision=precision, threads=1)
    assert same_bits([copy.positions], [expected[0].astype(np.float32)])
    copy.set_scene(SMALL)
    assert copy.scene == SMALL


def test_set_scene_can_pin_and_let_go():
    stepper = cs.Stepper(SMALL.replace(spheres=()))
    stepper.advance(200, 1e-3)
    before = stepper.positions
    pinned_cloth = CLOTH.replace(pins=((0, 0), (-1, 0), (3, 3)))
    stepper.set_scene(stepper.scene.replace(cloth=pinned_cloth))
    assert not stepper.velocities[3, 3].any() and stepper.velocities[3, 4].any()
    stepper.advance(200, 1e-3)
    assert (stepper.positions[3, 3] == before[3, 3]).all()
    stepper.set_scene(stepper.scene.replace(cloth=CLOTH.replace(pins=((0, 0),))))
    stepper.advance(200, 1e-3)
    assert stepper.positions[3, 3, 1] < before[3, 3, 1]
    assert stepper.positions[-1, 0, 1] < -0.01 and not stepper.positions[0, 0].any()


def test_pickles_of_a_stepper_are_refused_and_those_of_a_snapshot_pass():
    stepper = cs.Stepper(cs.scenes.oscillator())
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        with pytest.raises(TypeError, match=r"pickle stepper\.snapshot\(\)"):
            pickle.dumps(stepper, protocol)
        assert (
            cs.Stepper.restore(pickle.loads(pickle.dumps(stepper.snapshot(), protocol))).time == 0.0
        )
