"""What is left out and what is not done: absent features, traffic."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.gpu import block, parameters

BALL = cs.Sphere((0.6, -0.2, 0.4), 0.25, response="ray", offset="edge")
GPU = {"backend": "gpu", "precision": "single"}
FAMILIES = ("structural", "shear", "bend")


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("damped", [True, False])
def test_what_a_scene_leaves_out_is_not_in_its_shader(family, damped, crumpled, monkeypatch, same_bits):
    """Its numbers are made NaN: whatever looked at one would spread it over the cloth."""
    features = {"springs": (family,), "damped_by": "springs" if damped else "nothing", "mass": "uniform", "pins": ()}
    scene, x, v, dt = crumpled(**features)
    expected = cs.step(scene, x, v, dt, 20, **GPU)
    real = parameters.scene_parameters

    def poisoned(scene, speed_limit, dtype):
        table = real(scene, speed_limit, dtype)
        for (name, *_), spring in zip(parameters._SPRINGS, table[5:20].reshape(5, 3), strict=True):
            spring[0 if name != family else 3 if damped else 2 :] = np.nan
        table[3] = np.nan  # damping of points
        table[parameters.FIRST_WEIGHT :] = np.nan
        return table

    monkeypatch.setattr(parameters, "scene_parameters", poisoned)
    result = cs.step(scene, x, v, dt, 20, **GPU)
    assert np.isfinite(result[0]).all() and same_bits(result, expected)


def test_the_state_stays_on_the_adapter_between_calls(crumpled, monkeypatch, same_bits):
    scene, x, v, dt = crumpled(spheres=BALL)
    stepper, other = cs.Stepper(scene, x, v, **GPU), cs.Stepper(scene, x, v, **GPU)
    for each in (stepper, other):
        each.advance(3, dt)

    def moved(*args):
        raise AssertionError("the state was moved")

    with monkeypatch.context() as patched:
        patched.setattr(block.Block, "upload", moved)
        patched.setattr(block.Block, "download", moved)
        for n in (1, 5, 40):
            stepper.advance(n, dt)
        with pytest.raises(AssertionError, match="was moved"):
            stepper.positions
    other.advance(46, dt)
    assert same_bits((stepper.positions,), (other.positions,))
