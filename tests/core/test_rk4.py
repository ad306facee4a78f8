"""The paper's printed form of RK4; test_integrators.py fits the order of every method."""

import math

import clothsim as cs
import numpy as np


def test_the_printed_form_is_not_consistent():
    """Its error grows towards the whole amplitude as the time step goes to 0: it stands still."""
    scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    state = scene.initial_position, scene.initial_velocity
    duration = math.pi / 10  # half a period: from one end to the other
    errors = []
    for n in (10, 100, 1000, 10000):
        x, _ = cs.reference_step(scene, *state, duration / n, n, as_printed=True)
        errors.append(abs(x[0, 1, 0] - 0.9))
    assert (np.diff(errors) > 0).all()
    np.testing.assert_allclose(errors[-1], 0.2, rtol=1e-6)


def test_the_printed_form_is_rk4_with_the_squared_step(crumpled, relative):
    scene, x, v, dt = crumpled()
    printed = cs.reference_step(scene, x, v, math.sqrt(dt), 20, as_printed=True)
    assert relative(printed, cs.reference_step(scene, x, v, dt, 20), x) < 1e-12
