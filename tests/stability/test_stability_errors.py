"""Above the limit: the warning, the error, and what becomes of the rest of a batch."""

import warnings

import clothsim as cs
import numpy as np
import pytest

quiet = pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")


def stiff(stiffness=900.0):
    cloth = cs.Cloth((6, 7), stiffness=stiffness, damping=0.0, mass=4.2)
    noise = 1e-3 * np.random.default_rng(1).normal(size=(6, 7, 3))
    return cs.Scene(cloth, gravity=(0, 0, 0), position=cloth.rest_positions + noise)


def caught(run):
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        run()
    return [warning for warning in records if warning.category is cs.StabilityWarning]


def test_a_stepper_warns_once_with_the_limit_at_the_callers_line():
    scene = stiff()
    limit = cs.max_stable_dt(scene)
    stepper = cs.Stepper(scene)
    assert not caught(lambda: stepper.advance(1, limit))
    (first,) = caught(lambda: stepper.advance(1, 1.01 * limit))
    assert f"dt = {1.01 * limit:g} s is above {limit:.3g} s" in str(first.message)
    assert "rk4" in str(first.message) and first.filename == __file__
    assert not caught(lambda: stepper.advance(1, 1.02 * limit))


def test_step_and_simulate_warn_at_the_callers_line():
    scene = stiff()
    dt = 1.01 * cs.max_stable_dt(scene)
    x, v = scene.initial_position, scene.initial_velocity
    for call in (lambda: cs.step(scene, x, v, dt), lambda: cs.simulate(scene, 3 * dt, dt)):
        (warning,) = caught(call)
        assert warning.filename == __file__
    # The second, coarser run of an estimate is not the caller's.
    assert not caught(lambda: cs.simulate(scene, 3 * dt, 0.6 * dt, estimate_error=True))


def test_a_batch_names_the_member_with_the_lowest_limit():
    scenes = [stiff(), stiff(9e4), stiff(9e3)]
    limit = cs.max_stable_dt(scenes[1])
    (warning,) = caught(lambda: cs.Stepper(scenes).advance(1, 1.1 * limit))
    assert f"{limit:.3g} s" in str(warning.message) and "batch member 1" in str(warning.message)


def test_the_limit_is_that_of_the_integrator():
    scene = stiff()
    dt = 0.9 * cs.max_stable_dt(scene)
    assert cs.max_stable_dt(scene, "semi_implicit_euler") < dt
    assert not caught(lambda: cs.Stepper(scene).advance(1, dt))
    (warning,) = caught(lambda: cs.Stepper(scene, integrator="semi_implicit_euler").advance(1, dt))
    assert "semi_implicit_euler" in str(warning.message)
    assert not caught(lambda: cs.Stepper(scene, integrator="implicit_midpoint").advance(1, dt))


@quiet
@pytest.mark.parametrize("threads", [1, 2])
def test_the_rest_of_a_batch_goes_on_with_the_bits_it_has_alone(precision, threads, same_bits):
    """Members 1 and 3 blow up one after the other; 0 and 2 do not notice."""
    scenes = [stiff(0.9), stiff(3_000.0), stiff(9.0), stiff(9_000.0)]
    dt = 0.9 * cs.max_stable_dt(stiff())
    steps = 300
    options = {"precision": precision, "threads": threads}
    stepper = cs.Stepper(scenes, t=0.5, **options)
    steps_before = 0
    failures = []
    while steps_before < steps:
        try:
            stepper.advance(steps - steps_before, dt)
            steps_before = steps
        except cs.UnstableError as error:
            steps_before += error.step - 1
            failures.append(error.member)
            assert f"of batch member {error.member}" in str(error)
            np.testing.assert_array_equal(stepper.positions[error.member], error.x)
            for k, scene in enumerate(scenes):  # all of them stand at that step
                single = cs.Stepper(scene, t=0.5, **options)
                if k not in failures[:-1]:
                    single.advance(steps_before, dt)
                    assert same_bits(
                        (stepper.positions[k], stepper.velocities[k]),
                        (single.positions, single.velocities),
                    )
            positions = error.x
            stepper.freeze(error.member)
    assert failures == [3, 1]
    np.testing.assert_array_equal(stepper.positions[1], positions)
    assert stepper.time == 0.5 + steps * dt
    for k in (0, 2):
        single = cs.Stepper(scenes[k], t=0.5, **options)
        single.advance(steps, dt)
        assert same_bits(
            (stepper.positions[k], stepper.velocities[k]), (single.positions, single.velocities)
        )


@quiet
@pytest.mark.parametrize("integrator", ["velocity_verlet", "semi_implicit_euler", "pefrl"])
def test_an_energy_that_swings_is_not_taken_for_growth(integrator, precision):
    """Right below the true limit, above the guarantee, symplectic methods keep another energy."""
    scene = stiff()
    limit = cs.max_stable_dt(scene, integrator, scene.initial_position) / 0.97
    assert 0.98 * limit > cs.max_stable_dt(scene, integrator)
    still = scene.replace(
        position=None,
        velocity=1e-2
        * (scene.initial_position - scene.cloth.rest_positions)
        * ~scene.cloth.pinned[..., None],
    )
    cs.Stepper(still, integrator=integrator, precision=precision).advance(3000, 0.98 * limit)


@quiet
def test_rounding_at_rest_is_not_taken_for_growth(precision):
    cloth = cs.Cloth((9, 9), damping=0.0)
    scene = cs.Scene(cloth, gravity=(0, 0, 0))
    dt = 0.9 * cs.max_stable_dt(scene, x=cloth.rest_positions)
    assert dt > cs.max_stable_dt(scene)
    cs.Stepper(scene, precision=precision).advance(3000, dt)
