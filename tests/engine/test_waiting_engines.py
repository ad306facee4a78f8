"""Engines wait at their scene for the next call of `step` or `acceleration`: nothing of one call reaches the next."""

import pickle
import threading

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


@pytest.mark.parametrize("options", [{}, {"precision": "single"}, {"integrator": "velocity_verlet"}, {"strict": True}])
def test_later_calls_have_the_bits_of_a_new_engine(scene, options):
    for seed in range(3):
        x, v = state(scene, seed)
        found = cs.step(scene, x, v, DT, steps=3, **options)
        for mine, theirs in zip(found, fresh(scene, x, v, **options)):
            assert np.array_equal(mine, theirs)
        a = cs.acceleration(scene, x, v, precision=options.get("precision", "double"))
        assert np.array_equal(
            a, cs.acceleration(pickle.loads(pickle.dumps(scene)), x, v, precision=options.get("precision", "double"))
        )
    assert 1 <= len(scene.engines) <= 2
    assert all(len(waiting) == 1 for waiting in scene.engines.values())


def test_a_batch_of_scenes(scene):
    scenes = [scene.replace(gravity=(0, -k, 0)) for k in range(1, 4)]
    x, v = (np.stack([part] * 3) for part in state(scene))
    for _ in range(2):
        found = cs.step(scenes, x, v, DT, steps=3)
        for k, one in enumerate(scenes):
            assert np.array_equal(found[0][k], fresh(one, x[k], v[k])[0])
    other = [scene.replace(gravity=(0, k, 0)) for k in range(1, 4)]
    other[0] = scenes[0]
    assert not np.array_equal(cs.step(other, x, v, DT, steps=3)[0][1], found[0][1])


def test_a_state_that_goes_bad_is_found_at_its_step(scene):
    x, v = state(scene)
    cs.step(scene, x, v, DT, steps=20)
    v[5, 6] = 1e308
    errors = []
    for call in (lambda: cs.step(scene, x, v, DT, steps=20), lambda: fresh(scene, x, v, 20)):
        with pytest.raises(cs.UnstableError) as caught:
            call()
        errors.append(caught.value)
    assert (errors[0].step, errors[0].point, errors[0].time) == (errors[1].step, errors[1].point, errors[1].time)
    assert np.array_equal(errors[0].x, errors[1].x) and np.array_equal(errors[0].v, errors[1].v)


def test_time_and_warnings_begin_anew():
    sphere = cs.Sphere((0.5, -0.3, 0.5), 0.25, cs.Linear((0, 1, 0)), response="ray", offset="edge")
    scene = cs.Scene(cs.Cloth(), sphere)
    x, v = scene.initial_position, scene.initial_velocity
    with pytest.raises(ValueError, match="t must be given"):
        cs.step(scene, x, v, DT)
    early, late, again = (cs.step(scene, x, v, DT, 5, t=t)[0] for t in (0.0, 0.2, 0.0))
    assert np.array_equal(early, again) and not np.array_equal(early, late)
    for _ in range(2):
        with pytest.warns(cs.StabilityWarning):
            cs.step(scene, x, v, 1.2 * cs.max_stable_dt(scene), t=0.0)


def test_another_instruction_set_is_another_engine(scene, monkeypatch):
    x, v = state(scene)
    found = {}
    for isa in cs.build_config()["instruction_sets_supported"]:
        monkeypatch.setenv("CLOTHSIM_ISA", isa)
        found[isa] = cs.step(scene, x, v, DT, steps=50)[0]
        assert np.array_equal(found[isa], fresh(scene, x, v, 50)[0])
    monkeypatch.setenv("CLOTHSIM_ISA", "none such")
    with pytest.raises(ValueError, match="none such"):
        cs.step(scene, x, v, DT)


def test_one_scene_serves_several_threads(scene):
    x, v = state(scene)
    wanted = fresh(scene, x, v, 50)[0]
    wrong = []

    def work():
        for _ in range(20):
            if not np.array_equal(cs.step(scene, x, v, DT, steps=50)[0], wanted):
                wrong.append(1)

    team = [threading.Thread(target=work) for _ in range(4)]
    for thread in team:
        thread.start()
    for thread in team:
        thread.join()
    assert not wrong
    assert all(len(waiting) <= 2 for waiting in scene.engines.values())


def test_steps_are_taken_back_to_the_arrays_of_the_call(kernel, precision, same_bits):
    """A sphere comes near, so that steps without its contact pass are done again, from the arrays that the caller keeps."""
    sphere = cs.Sphere((0.5, -0.3, 0.5), 0.28, cs.Linear((0, 6.0, 0)), response="continuous", offset="face", restitution=1.0)
    scene = cs.Scene(cs.Cloth((12, 14), mass=20.0), sphere)
    x, v = scene.initial_position, scene.initial_velocity
    options = {"kernel": kernel, "precision": precision, "threads": 1}
    cs.step(scene, x, v, 1e-4, 1, t=0.0, **options)
    for steps in (60, 127, 300):
        stepper = cs.Stepper(scene, x, v, t=0.0, **options)
        stepper.advance(steps, 1e-4)
        found = cs.step(scene, x, v, 1e-4, steps, t=0.0, **options)
        assert same_bits(found, (stepper.positions, stepper.velocities))
    assert np.abs(found[1]).max() > 1  # the sphere has hit the cloth


def test_a_batch_whose_member_goes_bad_leaves_every_array_as_it_was(scene):
    x, v = (np.stack([part] * 3) for part in state(scene))
    scenes = [scene, scene.replace(gravity=(0, 1, 0)), scene]
    cs.step(scenes, x, v, DT)
    v[1, 5, 6] = 1e308
    x_given, v_given = x.copy(), v.copy()
    with pytest.raises(cs.UnstableError) as later:
        cs.step(scenes, x, v, DT, steps=20, out=(x, v))
    with pytest.raises(cs.UnstableError) as alone:
        fresh(scenes[1], x_given[1], v_given[1], 20)
    assert (later.value.member, later.value.step, later.value.point) == (1, alone.value.step, alone.value.point)
    assert np.array_equal(later.value.x, alone.value.x)
    assert np.array_equal(x, x_given) and np.array_equal(v, v_given)


def test_a_velocity_of_a_pinned_point_is_checked_by_later_calls_too(scene):
    x, v = state(scene)
    pinned = tuple(np.argwhere(scene.cloth.pinned)[0])
    for precision, value in (("double", np.nan), ("single", 1e300)):
        for _ in range(2):
            bad = v.copy()
            bad[pinned] = value
            for call in (cs.step, cs.acceleration):
                with pytest.raises(ValueError, match="v must be"):
                    call(scene, x, bad, 0.001, precision=precision)
            cs.step(scene, x, v, DT, precision=precision)
            cs.acceleration(scene, x, v, precision=precision)
