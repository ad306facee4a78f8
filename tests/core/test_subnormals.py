"""Subnormal numbers are zero while the core computes, and only there."""

import signal
import sys

import clothsim as cs
import numpy as np
import pytest
from variants import NAMED_KERNELS, cases

METHODS = ("rk4", "velocity_verlet", "dopri5")


def faint(precision, shape=(17, 20)):
    """Return a flat sheet whose heights and speeds are subnormal, or soon will be."""
    tiny = np.finfo({"single": np.float32, "double": np.float64}[precision]).tiny
    scene = cs.Scene(
        cs.Cloth(shape, mass=1.0, stiffness=50.0, damping=0.1, drag=0.5), gravity=(0, 0, 0)
    )
    rng = np.random.default_rng(0)
    x = scene.initial_position.copy()
    v = np.zeros((*shape, 3))
    free = ~scene.cloth.pinned
    x[..., 1][free], v[..., 1][free] = tiny * rng.uniform(-4, 4, (2, free.sum()))
    return scene, x, v, tiny


def is_flushed(values, tiny):
    size = np.abs(np.stack(values))
    return size.max() > 0 and ((size == 0) | (size >= tiny)).all()


@cases()
def test_no_result_is_subnormal_and_threads_agree(variant, same_bits):
    scene, x, v, tiny = faint(variant.precision)
    for method in METHODS:
        options = variant.options | {"integrator": method}
        first = cs.step(scene, x, v, 1e-3, 20, **options)
        assert is_flushed(first, tiny), method
        assert same_bits(cs.step(scene, x, v, 1e-3, 20, **options | {"threads": 3}), first), method
        batch = cs.step(
            scene, np.stack([x, x]), np.stack([v, v]), 1e-3, 20, **options | {"threads": 2}
        )
        assert all(same_bits([part[k] for part in batch], first) for k in (0, 1)), method


def test_references_error_control_and_implicit_steps_flush_too():
    scene, x, v, tiny = faint("double")
    assert is_flushed(cs.reference_step(scene, x, v, 1e-3, 20), tiny)
    run = cs.simulate(scene.replace(position=x, velocity=v), 0.02, rtol=1e-3)
    assert is_flushed([run.x[-1], run.v[-1]], tiny)
    scene, x, v, tiny = faint("double", (5, 6))
    assert is_flushed(cs.step(scene, x, v, 1e-3, 5, integrator="implicit_midpoint"), tiny)


def flushes():
    """Whether this thread takes subnormal numbers as zero."""
    least = np.finfo(float).tiny
    return least * 0.5 == 0 or (np.full(16, least) * 0.5 == 0).any()


def test_the_setting_of_the_caller_comes_back():
    scene, x, v, _ = faint("double")
    stepper = cs.Stepper(scene, threads=2)
    calls = {
        "step": lambda: cs.step(scene, x, v, 1e-3),
        "advance": lambda: stepper.advance(300, 1e-3),
        "positions": lambda: stepper.positions,
        "acceleration": lambda: cs.acceleration(scene, x, v),
        "error control": lambda: cs.simulate(
            scene, 0.01, rtol=1e-3, callback=lambda *_: settings.append(flushes())
        ),
        "reference": lambda: cs.reference(scene, 0.01),
        "picture": lambda: cs.simulate(scene, 0.01, dt=1e-3).picture(),
        "an error": lambda: cs.step(scene, x, np.full_like(v, np.nan), 1e-3),
        "unstable": lambda: cs.step(scene, x, v + 1e200 * np.sign(x), 1e-3, 20),
    }
    settings = []
    for name, call in calls.items():
        try:
            call()
        except (ValueError, cs.UnstableError):
            assert name in ("an error", "unstable")
        else:
            assert name not in ("an error", "unstable")
        assert not flushes(), name
    assert settings and not any(settings)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("kernel", NAMED_KERNELS)
def test_a_handler_of_a_signal_has_the_setting_of_the_caller(kernel):
    settings = []
    before = signal.signal(signal.SIGALRM, lambda *_: settings.append(flushes()))
    signal.setitimer(signal.ITIMER_REAL, 0.01, 0.01)
    try:
        stepper = cs.Stepper(cs.scenes.paper_swing(), kernel=kernel)
        while not settings:
            stepper.advance(3000, 1e-5)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert not any(settings)
