"""What the adapter has of the core's care: origins of far cloths in single, and frozen members."""

import pickle

import clothsim as cs
import numpy as np
import pytest

SINGLE = {"precision": "single", "kernel": "gather"}
FAR = np.array([3000.0, -200.0, 0.0])


def arrays(stepper):
    return stepper.positions, stepper.velocities


def far_scene(crumpled, offset=FAR, **options):
    """A crumpled sheet, and a sphere in it, as far away as `offset` says."""
    ball = cs.Sphere(
        tuple(np.array([0.6, -0.2, 0.4]) + offset), 0.25, cs.Linear((0, 0.5, 0.1)), response="ray", offset="edge"
    )
    state = crumpled(spheres=ball, **options)
    return state.scene, state.x + offset, state.v, state.dt


@pytest.mark.usefixtures("needs_float64")
def test_far_away_single_has_the_bits_of_the_core(crumpled, same_bits):
    scene, x, v, dt = far_scene(crumpled)
    cpu, gpu = (cs.Stepper(scene, x, v, t=0.0, **SINGLE, backend=b) for b in ("cpu", "gpu"))
    for stepper in (cpu, gpu):
        stepper.advance(100, dt)
    free = cs.Stepper(scene.replace(spheres=()), x, v, **SINGLE)
    free.advance(100, dt)
    assert np.abs(free.positions - cpu.positions).max() > 1e-3
    assert same_bits(arrays(gpu), arrays(cpu))
    # Without an origin of its own, float32 would tell points apart by 2e-4 m there.
    double = cs.Stepper(scene.replace(spheres=()), x, v)
    double.advance(100, dt)
    assert np.abs(free.positions - double.positions).max() < 1e-6


def test_a_snapshot_keeps_the_origin(crumpled, same_bits):
    scene, x, v, dt = far_scene(crumpled)
    stepper = cs.Stepper(scene, x, v, t=0.0, **SINGLE, backend="gpu")
    stepper.advance(30, dt)
    other = cs.Stepper.restore(pickle.loads(pickle.dumps(stepper.snapshot())))
    assert same_bits(arrays(other), arrays(stepper))
    for each in (stepper, other):
        each.advance(30, dt)
    assert same_bits(arrays(other), arrays(stepper))


def test_a_frozen_member_rests_and_the_others_go_on(crumpled, same_bits):
    states = [crumpled(seed=1), crumpled(seed=2), crumpled(seed=3)]
    scenes, dt = [s.scene for s in states], min(s.dt for s in states)
    x, v = np.stack([s.x for s in states]), np.stack([s.v for s in states])
    frozen, whole = (cs.Stepper(scenes, x, v, t=0.0, **SINGLE, backend="gpu") for _ in range(2))
    for stepper in (frozen, whole):
        stepper.advance(20, dt)
    at_rest = arrays(frozen)
    frozen.freeze(0)
    assert same_bits(arrays(frozen), at_rest)
    for stepper in (frozen, whole):
        stepper.advance(30, dt)
    other = cs.Stepper.restore(frozen.snapshot())
    for stepper in (frozen, whole, other):
        stepper.advance(20, dt)
    assert frozen.frozen.tolist() == other.frozen.tolist() == [True, False, False]
    assert frozen.time == whole.time == other.time
    for stepper in (frozen, other):
        for now, rest, all_go in zip(arrays(stepper), at_rest, arrays(whole)):
            assert same_bits([now[0]], [rest[0]]) and same_bits([now[1:]], [all_go[1:]])
            assert not same_bits([now[0]], [all_go[0]])
    frozen.freeze(1)
    frozen.freeze(2)  # all
    frozen.advance(10, dt)
    assert frozen.time > other.time


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_a_batch_goes_on_without_the_member_that_became_unstable():
    scenes = [cs.scenes.oscillator(stiffness=k) for k in (1.0, 1e6)]
    stepper = cs.Stepper(scenes, **SINGLE, backend="gpu")
    with pytest.raises(cs.UnstableError) as raised:
        stepper.advance(300, 0.01)
    assert raised.value.member == 1
    stepper.freeze(1)
    stepper.advance(301 - raised.value.step, 0.01)
    assert stepper.time == pytest.approx(3.0, rel=1e-12, abs=0)
