"""The state that stays in the core: its clock, and what an unstable run leaves."""

import clothsim as cs
import numpy as np
import pytest


def test_the_clock_does_not_drift():
    """A million times 5e-6 s is 5 s, not 5 s and a million roundings."""
    stepper = cs.Stepper(cs.scenes.oscillator())
    for _ in range(1000):
        stepper.advance(1000, 5e-6)
    assert stepper.time == 10**6 * 5e-6
    stepper.advance(10, 1e-3)
    assert abs(stepper.time - 5.01) < 1e-14


def stiff(shape=(9, 20)):
    """Return an undamped sheet, for which the stability limit is sharp."""
    cloth = cs.Cloth(shape, stiffness=900.0, damping=0.0, mass=0.1 * shape[0] * shape[1])
    return cs.Scene(cloth)


def disturbed(scene, size=1e-3):
    return scene.initial_position + size * np.random.default_rng(1).normal(
        size=scene.initial_position.shape
    )


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_an_unstable_run_names_the_point_and_keeps_the_last_finite_state(variant):
    scene = stiff()
    x = disturbed(scene)
    dt = 1.4 * cs.max_stable_dt(scene)
    stepper = cs.Stepper(scene, x, t=0.5, **variant.options)
    stepper.advance(3, dt)
    with pytest.raises(cs.UnstableError) as raised:
        stepper.advance(5000, dt)
    error = raised.value
    assert error.dt == dt and error.max_stable_dt == cs.max_stable_dt(scene)
    assert error.member is None
    assert 1 <= error.step <= 5000
    assert np.isfinite(error.x).all() and np.isfinite(error.v).all()
    np.testing.assert_allclose(stepper.time, 0.5 + (3 + error.step - 1) * dt, rtol=1e-14)
    np.testing.assert_allclose(error.time, stepper.time + dt, rtol=1e-14)
    np.testing.assert_array_equal(error.x, stepper.positions)
    np.testing.assert_array_equal(error.v, stepper.velocities)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("part", [1.02, 1.5, 10.0])
def test_the_point_named_is_free(part, precision):
    """A pin stands apart from the mean motion as much as the only free point does."""
    scene = cs.scenes.oscillator()
    with pytest.raises(cs.UnstableError) as raised:
        cs.Stepper(scene, precision=precision).advance(100_000, part * cs.max_stable_dt(scene))
    assert raised.value.point == (0, 1)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_growth_above_the_stability_limit_is_an_error_before_it_is_absurd(kernel):
    """A sheet of 1 m whose points are 1e6 m apart is no result, finite or not."""
    scene = stiff()
    x = disturbed(scene)
    v = np.zeros_like(scene.initial_position)
    dt = 2 * cs.max_stable_dt(scene)
    with pytest.raises(cs.UnstableError) as raised:
        for _ in range(1000):
            x, v = cs.step(scene, x, v, dt, kernel=kernel)
            assert np.abs(x).max() < 1e6
    assert np.abs(raised.value.x).max() < 1e6
