"""The backend "gpu" differs from "cpu" only in where it computes, and refuses what it lacks."""

import pickle

import clothsim as cs
import numpy as np
import pytest
from commands import python

BALL = cs.Sphere(
    (0.6, -0.2, 0.4), 0.25, cs.Linear((0.0, 0.5, 0.1)), friction=0.1, response="ray", offset="edge"
)
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
    stepper = cs.Stepper(scene, x, v, t=0.0, **GPU)
    stepper.advance(40, dt)
    with pytest.raises(ValueError, match="force must be None"):
        stepper.set_scene(scene.replace(force=np.ones_like(x)))
    stepper.set_scene(scene)
    stepper.advance(40, dt)
    assert stepper.time == 80 * dt and same_bits(
        arrays(stepper), cs.step(scene, x, v, dt, 80, t=0.0, **GPU)
    )
    stepper.set_scene(scene.replace(cloth=scene.cloth.replace(pins=((3, 3),))))
    pin = stepper.positions[3, 3]
    assert not stepper.velocities[3, 3].any()
    stepper.advance(40, dt)
    np.testing.assert_array_equal(stepper.positions[3, 3], pin)


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize(
    "ball", [BALL, BALL.replace(response="reflect")], ids=lambda ball: ball.response
)
def test_a_batch_of_different_scenes_is_each_scene_bit_for_bit(ball, crumpled, same_bits):
    """Scenes of equal features share a dispatch, and none of their numbers."""
    states = [
        crumpled(seed=k, spheres=ball.replace(radius=0.2 + 0.02 * k, restitution=0.2 * k))
        for k in range(4)
    ]
    scenes = [s.scene for s in states]
    cloth = scenes[2].cloth
    softer = {family: 0.5 * k for family, k in cloth.family_stiffness.items()}
    cloth = cloth.replace(stiffness=softer, damping=0.1, size=(1.0, 1.1))
    scenes[2] = scenes[2].replace(cloth=cloth, gravity=(0.0, -1.6, 0.2))
    x, v = np.stack([s.x for s in states]), np.stack([s.v for s in states])
    dt = min(s.dt for s in states)
    result = cs.step(scenes, x, v, dt, 60, t=0.2, **GPU)
    for k, scene in enumerate(scenes):
        single = cs.step(scene, x[k], v[k], dt, 60, t=0.2, **GPU)
        assert same_bits([part[k] for part in result], single), k


def test_a_frozen_member_rests_and_a_restored_snapshot_continues_with_the_same_bits(
    crumpled, same_bits
):
    states = [crumpled(seed=seed, spheres=BALL) for seed in (1, 2, 3)]
    scenes = [s.scene for s in states]
    dt = min(s.dt for s in states)
    x, v = np.stack([s.x for s in states]), np.stack([s.v for s in states])
    frozen, free = (cs.Stepper(scenes, x, v, t=0.0, **GPU) for _ in range(2))
    for stepper in (frozen, free):
        stepper.advance(20, dt)
    at_rest = arrays(frozen)
    frozen.freeze(0)
    assert same_bits(arrays(frozen), at_rest)
    for stepper in (frozen, free):
        stepper.advance(30, dt)
    other = cs.Stepper.restore(pickle.loads(pickle.dumps(frozen.snapshot())))
    for stepper in (frozen, free, other):
        stepper.advance(20, dt)
    assert frozen.frozen.tolist() == other.frozen.tolist() == [True, False, False]
    assert frozen.time == free.time == other.time
    for stepper in (frozen, other):
        for array, rest, moving in zip(arrays(stepper), at_rest, arrays(free)):
            assert same_bits([array[0]], [rest[0]]) and same_bits([array[1:]], [moving[1:]])
            assert not same_bits([array[0]], [moving[0]])
    frozen.freeze(1)
    frozen.freeze(2)  # Now all members are frozen.
    frozen.advance(10, dt)
    assert frozen.time > other.time


def test_simulate_reports_the_backend(device):
    scene = cs.scenes.paper_swing()
    run = cs.simulate(scene, 0.0105, dt=1e-3, every=4, **GPU)
    assert run.report["backend"] == "gpu" and device.adapter.name in run.report["instruction_set"]
    assert run.report["steps"] == 11 and run.t.tolist() == [0.0, 4e-3, 8e-3, 0.0105]
    assert np.abs(run.x - cs.simulate(scene, 0.0105, dt=1e-3, every=4).x).max() < 1e-7


def test_frames_within_steps_are_those_of_the_gather_kernel(same_bits):
    cloth = cs.Cloth((9, 9), mass=0.3, stiffness=200.0, damping=0.1)
    scene = cs.Scene(cloth, BALL)
    seen = []
    options = {"dt": 1e-3, "every": 7.3e-4, "precision": "single"}
    run = cs.simulate(scene, 0.1205, **options, backend="gpu")
    core = cs.simulate(scene, 0.1205, **options, kernel="gather")
    assert core.report["first_contact"]["time"] < 0.1  # Frames after it are lifted.
    assert len(run.t) == 167 and run.t.tolist() == core.t.tolist()
    assert same_bits([run.x, run.v], [core.x, core.v])
    cs.simulate(
        scene, 0.1205, **options, backend="gpu", callback=lambda t, x, v: seen.append((t, x))
    )
    assert same_bits([run.t, run.x], [np.array(values) for values in zip(*seen)])


CLOTH = cs.Cloth((12, 12))
LAYER = cs.Sphere((0.5, -0.3, 0.5), 0.25, motion=cs.Linear((0.0, 0.5, 0.0)))


def test_simulate_tells_contact_with_layers_as_far_as_frames_show_it():
    scene = cs.Scene(CLOTH, LAYER)
    options = {"dt": 4e-4, "every": 25, "precision": "single"}
    gpu = cs.simulate(scene, 0.2, backend="gpu", **options)
    cpu = cs.simulate(scene, 0.2, kernel="gather", **options)
    np.testing.assert_array_equal(gpu.x, cpu.x)
    assert 0 < gpu.report["first_contact"]["time"] == cpu.report["first_contact"]["time"] < 0.2
    assert gpu.report["first_contact"]["reason"] == ""
    depths = [cs.penetration(x, LAYER, t) for x, t in zip(gpu.x, gpu.t)]
    for name in ("points", "triangles"):
        assert gpu.report["penetration"][name] == max(depth[name] for depth in depths)
    for name in ("impulse", "obstacle_work"):
        assert np.isnan(gpu.report[name]).all()
    assert "does not watch" in gpu.report["impulse_reason"]
    free = cs.simulate(scene, 0.01, dt=4e-4, **GPU).report["first_contact"]
    assert np.isnan(free["time"]) and free["reason"] == "no sphere responded"
    mixed = scene.replace(spheres=(LAYER, BALL.replace(center=(0.6, -0.3, 0.4))))
    first = cs.simulate(mixed, 0.2, dt=4e-4, **GPU).report["first_contact"]
    assert np.isnan(first["time"]) and "does not watch" in first["reason"]


def test_a_point_that_goes_through_a_layer_is_named_as_on_the_cpu():
    scene = cs.Scene(CLOTH, (cs.Plane((0, -9, 0)), LAYER.replace(stiffness=500.0)))
    scenes = [scene.replace(spheres=()).replace(spheres=scene.spheres), scene]
    errors = []
    for options in (GPU, {"precision": "single", "kernel": "gather"}):
        stepper = cs.Stepper(scenes, **options)
        with pytest.raises(cs.ContactError, match=r"spheres\[1\]") as error:
            stepper.advance(2000, 4e-4)
        names = "step", "time", "point", "obstacle", "member"
        errors.append([getattr(error.value, name) for name in names])
        errors[-1].append(error.value.x.tobytes())
    assert errors[0] == errors[1]


def test_a_batch_of_layers_is_each_scene_bit_for_bit(same_bits):
    """Friction or none is no feature, so that a dispatch serves both."""
    scenes = [
        cs.Scene(CLOTH, LAYER.replace(radius=0.2 + 0.02 * k, friction=0.2 * k)) for k in range(3)
    ]
    x = np.stack([scene.initial_position for scene in scenes])
    result = cs.step(scenes, x, 0 * x, 4e-4, 400, t=0.0, **GPU)
    for k, scene in enumerate(scenes):
        single = cs.step(scene, x[k], 0 * x[k], 4e-4, 400, t=0.0, **GPU)
        assert same_bits([part[k] for part in result], single), k
        energy = cs.energy(scene, *single, 0.16)
        assert energy["contact"] > 0


@pytest.mark.parametrize(
    "change, dt, warning",
    [
        ({"offset": "none", "thickness": 0.004, "stiffness": 40_000.0}, 2e-4, "below the true"),
        ({"stiffness": 3e6, "dissipation": 20.0}, 5e-3, "deep in the layer"),
    ],
)
def test_a_deep_contact_is_warned_of_as_on_the_cpu(change, dt, warning):
    scene = cs.Scene(CLOTH, LAYER.replace(**change))
    for options in (GPU, {"precision": "single", "kernel": "gather"}):
        with pytest.warns(UserWarning, match=warning):
            cs.simulate(scene, 0.16, dt=dt, every=10, **options)


def test_a_pin_in_an_obstacle_is_warned_of():
    ball = LAYER.replace(center=(0.0, 0.1, 0.0), radius=0.15, motion=None)
    scene = cs.Scene(CLOTH.replace(pins=((0, 0),)), ball)
    x = scene.initial_position + [0.0, -0.2, 0.0]
    x[0, 0, 1] = 0.0
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 0\) is inside"):
        cs.Stepper(scene, x, 0 * x, **GPU).advance(1, 1e-5)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"rtol": 1e-3}, "rtol and atol must be None"),
        ({"integrator": "auto"}, "integrator must be 'rk4' with backend 'gpu'"),
        ({"dt": 1e-4, "integrator": "pefrl"}, "must be 'rk4' with backend 'gpu', got 'pefrl'"),
        *(
            ({"dt": 1e-4, name: value}, f"^{name} must be")
            for name, value in (("kernel", "edge"), ("threads", 2))
        ),
    ],
)
@pytest.mark.needs_no_adapter
def test_an_option_that_it_does_not_have_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        cs.simulate(cs.scenes.paper_swing(), 0.01, backend="gpu", **options)


SWING = cs.scenes.paper_swing()
REFUSED = {
    r"^pins\[\(0, 0\)\] must be None": SWING.replace(
        cloth=SWING.cloth.replace(pins={(0, 0): cs.Linear((0, 1, 0))})
    ),
    r"^drag of all members must be equal .* got True for member 1": [
        SWING,
        SWING.replace(cloth=SWING.cloth.replace(drag=1.0)),
    ],
}


@pytest.mark.parametrize("message", REFUSED)
def test_a_scene_that_it_does_not_have_is_refused(message):
    with pytest.raises(ValueError, match=message):
        cs.Stepper(REFUSED[message], **GPU)


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


def test_a_run_says_that_contact_and_obstacles_are_not_told_apart():
    """The adapter tells no works of obstacles and no first contact of the paper's responses."""
    run = cs.simulate(cs.scenes.paper_moving(), 0.5, dt=1e-3, precision="single", backend="gpu")
    change = str(run).splitlines()[3]
    assert change.endswith(" J by damping, contact, moving obstacles and the method")
