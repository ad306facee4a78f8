"""`backend="gpu"` is `backend="cpu"` in all but where it computes."""

import pickle

import clothsim as cs
import numpy as np
import pytest
from clothsim.gpu import device as devices
from commands import python

BALL = cs.Sphere((0.6, -0.2, 0.4), 0.25, cs.Linear((0.0, 0.5, 0.1)), friction=0.1, response="ray", offset="edge")
GPU = {"backend": "gpu", "precision": "single"}


def arrays(stepper):
    return stepper.positions, stepper.velocities


def test_a_stepper_is_step_in_parts(crumpled, same_bits):
    scene, x, v, dt = crumpled(spheres=BALL)
    stepper = cs.Stepper(scene, x, v, t=0.0, **GPU)
    for n in (1, 0, 7, 97, 45):
        stepper.advance(n, dt)
    assert same_bits(arrays(stepper), cs.step(scene, x, v, dt, 150, t=0.0, **GPU))
    assert stepper.time == 150 * dt


def test_a_new_scene_keeps_the_state_and_one_that_is_refused_changes_nothing(crumpled, same_bits):
    scene, x, v, dt = crumpled(spheres=BALL)
    stepper, twin = (cs.Stepper(scene, x, v, t=0.0, **GPU) for _ in "ab")
    for one in (stepper, twin):
        one.advance(40, dt)
    with pytest.raises(ValueError, match="force must be None"):
        stepper.set_scene(scene.replace(force=np.ones_like(x)))
    stepper.set_scene(scene)
    for one in (stepper, twin):
        one.advance(40, dt)
    assert stepper.time == twin.time and same_bits(arrays(stepper), arrays(twin))
    stepper.set_scene(scene.replace(cloth=scene.cloth.replace(pins=((3, 3),))))
    held = stepper.positions[3, 3]
    assert not stepper.velocities[3, 3].any()
    stepper.advance(40, dt)
    np.testing.assert_array_equal(stepper.positions[3, 3], held)


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("float64", [True, False])
@pytest.mark.parametrize("ball", [BALL, BALL.replace(response="continuous", offset="cell")], ids=lambda ball: ball.response)
def test_a_batch_of_different_scenes_is_each_scene_bit_for_bit(ball, float64, crumpled, same_bits, device, monkeypatch):
    """Scenes of equal features share a dispatch, and none of their numbers."""
    if not float64:
        narrow = devices.Device(device.adapter, float64=False)
        monkeypatch.setattr(devices, "opened", lambda: narrow)
    states = [crumpled(seed=k, spheres=ball.replace(radius=0.2 + 0.02 * k, restitution=0.2 * k)) for k in range(4)]
    scenes = [s.scene for s in states]
    cloth = scenes[2].cloth
    softer = {family: 0.5 * k for family, k in cloth.family_stiffness.items()}
    cloth = cloth.replace(stiffness=softer, damping=0.1, size=(1.0, 1.1))
    scenes[2] = scenes[2].replace(cloth=cloth, gravity=(0.0, -1.6, 0.2))
    x, v = np.stack([s.x for s in states]), np.stack([s.v for s in states])
    dt = min(s.dt for s in states)
    result = cs.step(scenes, x, v, dt, 60, t=0.2, **GPU)
    for k, scene in enumerate(scenes):
        alone = cs.step(scene, x[k], v[k], dt, 60, t=0.2, **GPU)
        assert same_bits([part[k] for part in result], alone), k


def test_a_restored_snapshot_continues_with_the_same_bits(crumpled, same_bits):
    scene, x, v, dt = crumpled(spheres=BALL)
    x, v = np.stack([x, x]), np.stack([v, 2 * v])
    stepper = cs.Stepper(scene, x, v, t=0.25, **GPU)
    stepper.advance(40, dt)
    snapshot = pickle.loads(pickle.dumps(stepper.snapshot()))
    stepper.advance(60, dt)
    for _ in range(2):
        other = cs.Stepper.restore(snapshot)
        other.advance(60, dt)
        assert other.backend == "gpu" and other.time == stepper.time
        assert same_bits(arrays(other), arrays(stepper))


def test_simulate_reports_the_backend(device):
    scene = cs.scenes.paper_swing()
    run = cs.simulate(scene, 0.0105, dt=1e-3, every=4, backend="gpu", precision="single")
    assert run.report["backend"] == "gpu" and device.adapter.name in run.report["instruction_set"]
    assert run.report["steps"] == 11 and run.t.tolist() == [0.0, 4e-3, 8e-3, 0.0105]
    expected = cs.simulate(scene, 0.0105, dt=1e-3, every=4)
    assert expected.report["backend"] == "cpu"
    assert np.abs(run.x - expected.x).max() < 1e-7


def test_contacts_are_counted_as_in_the_core(crumpled, precision, needs_float64):
    scene, x, v, dt = crumpled(spheres=(BALL, BALL.replace(center=(0.3, -0.2, 0.4))))
    x, v = np.stack([x + 3.0, x]), np.stack([v, v])
    counts = []
    for backend in ("cpu", "gpu"):
        stepper = cs.Stepper(scene, x, v, t=0.0, precision=precision, kernel="gather", backend=backend)
        stepper.advance(130, dt)
        counts.append(stepper._state.core.contacts)
    assert counts[0] == counts[1] and counts[0][0] == 0 and counts[0][1] > 100


@pytest.mark.parametrize(
    "asked, accepted",
    [
        ({"rtol": 1e-3}, "rtol and atol must be None"),
        ({"atol": 1e-3}, "rtol and atol must be None"),
        ({"integrator": "auto"}, "integrator must be 'rk4' with backend 'gpu'"),
        ({"integrator": "dop853"}, "integrator must be 'rk4'"),
        ({"dt": 1e-4, "integrator": "pefrl"}, "must be 'rk4' with backend 'gpu', got 'pefrl'"),
    ],
)
@pytest.mark.needs_no_adapter
def test_simulate_takes_fixed_steps_of_rk4_only(asked, accepted):
    with pytest.raises(ValueError, match=accepted):
        cs.simulate(cs.scenes.paper_swing(), 0.01, backend="gpu", **asked)


@pytest.mark.parametrize(
    "name, value", [("kernel", "edge"), ("threads", 2), ("integrator", "verlet"), ("precision", "half")]
)
def test_what_it_does_not_have_is_refused(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        cs.Stepper(cs.scenes.paper_swing(), backend="gpu", **{name: value})


@pytest.mark.needs_no_adapter
def test_wgpu_is_loaded_by_nothing_but_the_backend():
    code = """
import sys, clothsim as cs, clothsim.gpu
cs.step(cs.scenes.paper_swing(), *[cs.Cloth().rest_positions] * 2, 1e-5)
assert not any(name.split(".")[0] == "wgpu" for name in sys.modules)
sys.modules["wgpu"] = None
try:
    cs.Stepper(cs.scenes.paper_swing(), backend="gpu")
except ImportError as error:
    print(error)
"""
    run = python(code)
    assert "pip install 'clothsim[gpu]'" in run.stdout, run.stderr
