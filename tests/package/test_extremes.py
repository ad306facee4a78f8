"""Odd uses of public objects: pickles, and callbacks that fail or change what they get."""

import pickle

import clothsim as cs
import numpy as np
import pytest

SCENE = cs.scenes.paper_moving()


def test_pickles_of_a_stepper_are_refused_and_those_of_a_snapshot_pass():
    stepper = cs.Stepper(cs.scenes.oscillator())
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        with pytest.raises(TypeError, match=r"pickle stepper\.snapshot\(\)"):
            pickle.dumps(stepper, protocol)
        assert cs.Stepper.restore(pickle.loads(pickle.dumps(stepper.snapshot(), protocol))).time == 0.0


def test_arrays_of_a_callback_cannot_be_made_writeable():
    seen = []

    def callback(t, x, v):
        seen.append((x, x.copy()))
        for array in (x, v):
            assert array.shape == (32, 32, 3) and array.dtype == np.float64
            while isinstance(array, np.ndarray):
                with pytest.raises(ValueError, match="WRITEABLE"):
                    array.flags.writeable = True
                array = array.base

    run = cs.simulate(SCENE, 0.01, dt=1e-3, every=2, callback=callback)
    assert all(np.array_equal(x, before) for x, before in seen)
    assert np.array_equal(run.x, [x for x, _ in seen])
