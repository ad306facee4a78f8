"""The order of the time integration, fitted over five time steps, and the paper's printed form."""

import functools
import math

import clothsim as cs
import numpy as np
from random_cloths import rms

DURATION = 0.05  # of the swing [s]


def fitted_order(steps, errors):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


@functools.cache
def _swing(oracle):
    scene = cs.scenes.paper_swing()
    return scene, oracle.solution(scene, DURATION)


def test_order_on_the_swing(kernel, oracle):
    scene, exact = _swing(oracle)
    state = scene.initial_position, scene.initial_velocity
    counts = np.array([100, 141, 200, 283, 400])
    errors = []
    for n in counts:
        x, _ = cs.step(scene, *state, DURATION / n, int(n), kernel=kernel)
        errors.append(rms(x - exact))
    assert abs(fitted_order(DURATION / counts, errors) - 4) < 0.15
    assert errors[-1] < 2e-12


def test_the_reference_has_the_order(oracle):
    scene, exact = _swing(oracle)
    state = scene.initial_position, scene.initial_velocity
    counts = np.array([100, 141, 200])
    errors = [rms(cs.reference_step(scene, *state, DURATION / n, int(n))[0] - exact) for n in counts]
    assert abs(fitted_order(DURATION / counts, errors) - 4) < 0.15


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
