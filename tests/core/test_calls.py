"""Many short calls are one long one, also where a run ends in an error."""

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core

BLOCK = _core.heuristics["steps_of_block"]
pytestmark = pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")


def arrays(stepper):
    return stepper.positions, stepper.velocities


def stiff(*spheres):
    """Return an undamped, disturbed sheet, and a step at which it tumbles for some blocks of steps,
    and then flies apart until numbers overflow.
    """
    cloth = cs.Cloth((9, 20), stiffness=900.0, damping=0.0, mass=18.0)
    scene = cs.Scene(cloth, spheres)
    x = scene.initial_position + 1e-3 * np.random.default_rng(1).normal(size=(9, 20, 3))
    return scene, x, 1.4 * cs.max_stable_dt(scene)


def unwatched(*args, **options):
    """Return a stepper that watches no speeds and energies: only an overflow is an error."""
    stepper = cs.Stepper(*args, **options)
    members = len(stepper.frozen)
    stepper._state.core.set_stable_dt([np.inf] * members)
    stepper._state.core.set_watch_energy(False)
    return stepper


def run(stepper, steps, dt, total=4000):
    """Return the number of steps before the error, and the error."""
    for steps_before in range(0, total, steps):
        try:
            stepper.advance(steps, dt)
        except cs.UnstableError as error:
            return steps_before + error.step - 1, error
    raise AssertionError("no error")


def test_short_calls_end_where_a_long_one_does(variant, same_bits):
    """The core goes back to a state of some calls ago to find the step that went wrong."""
    scene, x, dt = stiff()
    uncut = unwatched(scene, x, **variant.options)
    steps_before, error = run(uncut, 4000, dt)
    assert steps_before > 2 * BLOCK and np.abs(error.x).max() > 1e10
    for steps in (1, 7, BLOCK - 1, BLOCK, BLOCK + 1):
        parts = unwatched(scene, x, **variant.options)
        done_in_parts, error_in_parts = run(parts, steps, dt)
        assert (done_in_parts, error_in_parts.point) == (steps_before, error.point)
        assert error_in_parts.step == steps_before % steps + 1
        assert parts.time == uncut.time == steps_before * dt
        assert same_bits(arrays(parts), arrays(uncut))
        assert same_bits((error_in_parts.x, error_in_parts.v), (error.x, error.v))
        for stepper in (parts, uncut):
            with pytest.raises(cs.UnstableError) as raised:
                stepper.advance(3, dt)
            assert (raised.value.step, stepper.time) == (1, uncut.time)


def test_changes_between_calls_are_not_undone(kernel, precision, same_bits):
    """Time step and frozen members change while the core still keeps an older state."""
    scene, x, dt = stiff()
    soft = scene.replace(cloth=scene.cloth.replace(stiffness=1.0))
    v = np.zeros_like(x)
    options = {"kernel": kernel, "precision": precision, "threads": 1}
    stepper = unwatched([soft, scene, scene], np.stack([x] * 3), np.stack([v] * 3), **options)
    single = unwatched(scene, x, **options)
    for member in (stepper, single):
        for _ in range(10):
            member.advance(1, dt)
    stepper.freeze(2)
    row = stepper.positions[2]
    for member in (stepper, single):
        for _ in range(30):
            member.advance(1, dt / 2)
    steps_before, error = run(stepper, 1, dt)
    done_alone, _ = run(single, 1, dt)
    assert (error.member, steps_before) == (1, done_alone)
    assert same_bits([stepper.positions[1]], [single.positions])
    assert same_bits([stepper.positions[2]], [row])
    stepper.freeze(1)
    stepper.advance(5, dt)
    assert same_bits([stepper.positions[1]], [single.positions])
    expected = unwatched(soft, x, **options)
    for steps, step in ((10, dt), (30, dt / 2), (steps_before + 5, dt)):
        expected.advance(steps, step)
    assert same_bits([stepper.positions[0]], [expected.positions])
