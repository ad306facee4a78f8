"""A scene keeps spare states for the next call of `step` or `acceleration`: nothing of one call
reaches the next.
"""

import gc
import pickle
import sys
import threading
import weakref

import clothsim as cs
import numpy as np
import pytest

DT = 1e-4


@pytest.fixture
def scene():
    return cs.scenes.paper_swing().replace(gravity=(0.3, -9.8, 0.1))


def state(scene, seed=0):
    rng = np.random.default_rng(seed)
    free = ~scene.cloth.pinned[..., None]
    return (
        scene.initial_position + 1e-3 * free * rng.standard_normal((*scene.cloth.shape, 3)),
        1e-2 * free * rng.standard_normal((*scene.cloth.shape, 3)),
    )


def fresh(scene, x, v, steps=3, **options):
    stepper = cs.Stepper(scene, x, v, **options)
    stepper.advance(steps, DT)
    return stepper.positions, stepper.velocities


@pytest.mark.parametrize(
    "options",
    [{}, {"precision": "single"}, {"integrator": "velocity_verlet"}, {"kernel": "gather"}],
)
def test_later_calls_have_the_bits_of_a_new_state(scene, options):
    for seed in range(3):
        x, v = state(scene, seed)
        state_after = cs.step(scene, x, v, DT, steps=3, **options)
        for answer, expected in zip(state_after, fresh(scene, x, v, **options)):
            assert np.array_equal(answer, expected)
        a = cs.acceleration(scene, x, v, precision=options.get("precision", "double"))
        assert np.array_equal(
            a,
            cs.acceleration(
                pickle.loads(pickle.dumps(scene)),
                x,
                v,
                precision=options.get("precision", "double"),
            ),
        )
    assert 1 <= len(scene._spare_states) <= 2
    assert all(len(spares) == 1 for spares in scene._spare_states.values())


def test_one_scene_serves_several_threads(scene):
    x, v = state(scene)
    expected = fresh(scene, x, v, 50)[0]
    wrong = []

    def work():
        for _ in range(20):
            if not np.array_equal(cs.step(scene, x, v, DT, steps=50)[0], expected):
                wrong.append(1)

    team = [threading.Thread(target=work) for _ in range(4)]
    for thread in team:
        thread.start()
    for thread in team:
        thread.join()
    assert not wrong
    assert all(len(spares) <= 2 for spares in scene._spare_states.values())


@pytest.mark.parametrize("response", ["ray", "penalty"])
def test_a_call_that_meets_a_sphere_has_the_bits_of_a_stepper(
    response, kernel, precision, same_bits
):
    """The call keeps the state before its first block in the arrays of its caller."""
    sphere = cs.Sphere((0.5, -0.3, 0.5), 0.28, cs.Linear((0, 6.0, 0)), response)
    scene = cs.Scene(cs.Cloth((12, 14), mass=20.0), sphere)
    x, v = scene.initial_position, scene.initial_velocity
    options = {"kernel": kernel, "precision": precision, "threads": 1}
    cs.step(scene, x, v, 1e-4, 1, t=0.0, **options)
    for steps in (60, 127, 300):
        stepper = cs.Stepper(scene, x, v, t=0.0, **options)
        stepper.advance(steps, 1e-4)
        state_after = cs.step(scene, x, v, 1e-4, steps, t=0.0, **options)
        assert same_bits(state_after, (stepper.positions, stepper.velocities))
    assert np.abs(state_after[1]).max() > 1  # the sphere has hit the cloth


@pytest.mark.parametrize("batched", [False, True])
def test_spare_states_do_not_keep_their_scenes(batched):
    """The collector of cycles is off."""
    scene = cs.scenes.paper_swing()
    second = scene.replace(gravity=(0, -1, 0))
    x, v = state(scene)
    references = weakref.ref(scene), weakref.ref(second)
    gc.disable()
    try:
        for scenes in ([scene, second], [second, scene]) if batched else (scene, second):
            arrays = (np.stack([x, x]), np.stack([v, v])) if batched else (x, v)
            for _ in range(2):
                cs.step(scenes, *arrays, DT)
                cs.acceleration(scenes, *arrays)
        assert scene._spare_states and second._spare_states
        del scene, second, scenes
        assert [reference() for reference in references] == [None, None]
    finally:
        gc.enable()


def test_a_state_of_a_batch_serves_its_own_scenes_alone(scene):
    """A scene that died may leave its identity to another."""
    x, v = (np.stack([array, array]) for array in state(scene))
    for gravity in range(20):
        second = scene.replace(gravity=(0, -float(gravity), 0))
        state_after = cs.step([scene, second], x, v, DT, steps=3)
        assert np.array_equal(state_after[0][1], fresh(second, x[1], v[1])[0])
        del second


def test_another_thread_may_add_a_kind_of_call_at_any_moment():
    """It does so at each instruction of Python, where a scene has as many kinds as it may."""
    scene = cs.Scene(cs.Cloth((2, 2)))
    at = 0
    reached = True
    x, v = state(scene)
    while reached:
        kinds = scene.__dict__["_spare_states"] = {k: [] for k in range(8)}
        plans = scene.__dict__["_plans"] = dict.fromkeys(range(8))
        count = 0
        reached = False

        def trace(frame, event, argument, at=at, kinds=kinds, plans=plans):
            nonlocal count, reached
            frame.f_trace_opcodes = True
            if frame.f_code.co_name in ("_take_or_make_state", "cached_plan", "make_room_in_cache"):
                count += event == "opcode"
                if count == at:
                    kinds["more"] = plans["more"] = []
                    reached = True
            return trace

        sys.settrace(trace)
        try:
            cs.step(scene, x, v, DT)
        finally:
            sys.settrace(None)
        reached |= not at
        at += 1
    assert at > 100
