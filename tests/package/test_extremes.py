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


@pytest.mark.parametrize("how", [{"dt": 1e-3, "fps": 500}, {"rtol": 1e-3, "fps": 500}, {"dt": 1e-3, "every": "step"}])
@pytest.mark.parametrize("error", [KeyError("mine"), MemoryError(), ValueError("mine"), StopIteration()])
def test_an_exception_of_a_callback_has_the_frames_so_far(how, error, same_bits):
    calls = []

    def callback(t, x, v):
        calls.append(t)
        if len(calls) == 4:
            raise error

    with pytest.raises(type(error)) as caught:
        cs.simulate(SCENE, 0.02, callback=callback, **how)
    run = caught.value.run
    assert caught.value is error and run.t.tolist() == calls
    assert run.report["stopped"] == "callback"
    stopped = cs.simulate(SCENE, 0.02, callback=lambda t, x, v: t >= calls[-1], **how)
    assert same_bits([run.x, run.v], [stopped.x, stopped.v])
    if "dt" in how:
        assert same_bits([run.resume(0.005).x[-1]], [stopped.resume(0.005).x[-1]])


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
