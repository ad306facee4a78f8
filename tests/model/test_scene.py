"""The scene as plain data, and the error of an unstable run."""

import copy
import pickle

import numpy as np
import pytest
from clothsim.errors import UnstableError
from clothsim.measure import energy
from clothsim.model.cloth import Cloth
from clothsim.model.obstacle import Plane
from clothsim.model.scene import Scene

CLOTH = Cloth(shape=(3, 4))


def state(seed=1):
    x = np.random.default_rng(seed).normal(size=(3, 4, 3))
    v = x[::-1].copy()
    v[CLOTH.pinned] = 0.0
    return x, v


def test_state_is_copied_and_read_only():
    x, v = state()
    scene = Scene(CLOTH, position=x.astype(np.float32), velocity=v)
    v_before = v.copy()
    v[...] = 7.0
    np.testing.assert_array_equal(scene.initial_velocity, v_before)
    for clone in (scene, pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        for array in (clone.initial_position, clone.initial_velocity):
            assert array.dtype == np.float64 and array.flags.c_contiguous
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
    fortran = Scene(CLOTH, position=np.asfortranarray(x))
    np.testing.assert_array_equal(fortran.initial_position, x)
    assert fortran.initial_position.flags.c_contiguous


def test_another_cloth_has_other_layers():
    """They follow from the stiffness and the mass, also where the old cloth's are kept."""
    scene = Scene(CLOTH, Plane())
    state = scene.initial_position, scene.initial_velocity
    contact = energy(scene, *state)["contact"]
    soft = scene.replace(cloth=CLOTH.replace(stiffness=1000.0))
    assert energy(soft, *state)["contact"] == pytest.approx(contact / 35, rel=1e-12)


def test_unstable_error_keeps_its_state_through_pickling():
    x, v = state()
    error = UnstableError(
        step=4, time=0.04, point=(1, 2), dt=0.01, max_stable_dt=0.0016, x=x, v=v, member=3
    )
    assert isinstance(error, ArithmeticError)
    for e in (error, pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert (e.step, e.time, e.point, e.dt) == (4, 0.04, (1, 2), 0.01)
        assert (e.max_stable_dt, e.member) == (0.0016, 3)
        np.testing.assert_array_equal(e.x, x)
        np.testing.assert_array_equal(e.v, v)
        assert str(e) == str(error)
    for part in ("step 4", "t = 0.04 s", "(1, 2)", "batch member 3", "0.01 s", "0.0016 s"):
        assert part in str(error)


def test_unstable_error_blames_the_step_only_above_the_limit():
    error_above = UnstableError(step=1, time=0.1, dt=0.1, max_stable_dt=0.01)
    within = UnstableError(step=1, time=0.1, dt=0.001, max_stable_dt=0.01)
    unknown = UnstableError(step=1, time=0.1, dt=0.1)
    assert "above the stability limit" in str(error_above)
    assert "above" not in str(within) and "initial state" in str(within)
    assert "above" not in str(unknown) and "smaller dt" in str(unknown)
