"""The error of a run, carried along with it, against the error that the run has."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim.carried import CarriedError
from clothsim.frames import Schedule
from clothsim.runs import Options, integrate, perturbation, run_fixed


def options(integrator="dop853", precision="double", threads=1):
    return Options(integrator, precision, threads, "auto", False)


def rms(difference):
    return float(np.sqrt((difference**2).sum(axis=-1).mean()))


def exact(scene, duration, steps):
    state = scene.initial_position, scene.initial_velocity
    return cs.step(scene, *state, duration / steps, steps, integrator="dop853")[0]


def carried(scene, x, v, e, w, duration, substeps, part=1.0):
    state = options("rk4").state(scene, x, v)
    state.core.carry(x, v, e, w, duration, substeps, part, 1e-7, 1)


@pytest.mark.parametrize("part, damping", [(1.0, 0.0), (1.0, 3.0), (0.25, 3.0)])
def test_a_perturbation_moves_as_the_oscillator_does(part, damping):
    scene = cs.scenes.oscillator(damping=damping)
    x, v = scene.initial_position, np.zeros_like(scene.initial_position)
    e, w = np.zeros_like(x), np.zeros_like(x)
    e[0, 1, 0], duration = 1e-12, 0.4
    carried(scene, x, v, e, w, duration, 4000, part)
    g = part * damping / 2
    u = math.sqrt(100.0 - g * g)
    decay, phase = math.exp(-g * duration), u * duration
    expected = 1e-12 * decay * (math.cos(phase) + g / u * math.sin(phase))
    assert e[0, 1, 0] == pytest.approx(expected, rel=2e-3, abs=0)
    assert w[0, 1, 0] == pytest.approx(-1e-11 * decay * 10 / u * math.sin(phase), rel=2e-3, abs=0)
    assert not e[0, 0].any() and not e[0, 1, 1:].any()


def test_a_perturbation_of_a_cloth_moves_as_two_runs_part():
    scene = cs.scenes.paper_swing(bend=True)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-3, 200, integrator="dop853")
    e, w = perturbation(scene, 1e-8), np.zeros_like(x)
    duration = 2e-3
    runs = [cs.step(scene, x + k * e, v, duration / 20, 20) for k in (-1, 1)]
    carried(scene, x, v, e, w, duration, 100)
    # The derivatives are those at the start.
    assert rms(e - (runs[1][0] - runs[0][0]) / 2) < 0.02 * rms(e)
    assert rms(w - (runs[1][1] - runs[0][1]) / 2) < 0.05 * rms(w)


def test_the_perturbation_to_begin_with():
    scene = cs.scenes.paper_swing()
    noise = perturbation(scene, 1e-16)
    assert rms(noise) == pytest.approx(1e-16, rel=1e-12, abs=0)
    assert not noise[scene.cloth.pinned].any()
    assert perturbation(scene, 1e-16).tobytes() == noise.tobytes()


SCENES = {
    "oscillator": (lambda: cs.scenes.oscillator(), 1.0, 300),
    "damped": (lambda: cs.scenes.oscillator(damping=3.0), 1.0, 300),
    "swing": (lambda: cs.scenes.paper_swing(), 0.5, 1000),
    "swing with bend": (lambda: cs.scenes.paper_swing(bend=True), 0.5, 1000),
}
# Estimate over error, at most, and its inverse. Above it only where stability limits the steps of
# an adaptive method: what is stiff of the error then hardly fades, and is taken for more than it is.
FACTOR = 4.0
LIMITED = 40.0


@pytest.mark.parametrize(
    "name, integrator, dt",
    [
        ("oscillator", "semi_implicit_euler", 2e-3), ("oscillator", "velocity_verlet", 2e-2),
        ("oscillator", "pefrl", 0.04), ("oscillator", "rk4", 0.01), ("oscillator", "dopri5", 0.03),
        ("oscillator", "dop853", 0.05), ("damped", "semi_implicit_euler", 2e-3),
        ("damped", "velocity_verlet", 5e-3), ("damped", "rk4", 0.02), ("damped", "dop853", 0.1),
        ("swing with bend", "rk4", 8e-4), ("swing with bend", "dop853", 2.5e-3),
        ("swing", "semi_implicit_euler", 5e-4), ("swing", "dop853", 3e-3),
    ],
)  # fmt: skip
def test_the_estimate_of_a_fixed_step(name, integrator, dt):
    make, duration, steps = SCENES[name]
    scene = make()
    error = CarriedError(scene, duration, options(integrator))
    frames = Schedule(seconds=duration / 3)
    run = run_fixed(scene, duration, dt, options(integrator), frames, own_step=True, error=error)
    true = rms(run.x[-1] - exact(scene, duration, steps))
    assert true / FACTOR < rms(error.x) < FACTOR * true
    # It changes nothing of the run.
    plain = run_fixed(scene, duration, dt, options(integrator), frames, own_step=True)
    assert run.x.tobytes() == plain.x.tobytes()
    assert run.evaluations == plain.evaluations


def test_of_one_step_and_of_an_even_motion_the_error_is_known_closely():
    scene = cs.scenes.oscillator()
    error = CarriedError(scene, 0.02, options("rk4"))
    run = run_fixed(scene, 0.02, 0.02, options("rk4"), own_step=True, error=error)
    # From rest the error of x is of one order more than the method says.
    np.testing.assert_allclose(error.x, run.x[-1] - exact(scene, 0.02, 10), rtol=0.2, atol=1e-14)
    # Order 1: of a step's error two halves have a half themselves.
    error = CarriedError(scene, 1.0, options("semi_implicit_euler"))
    run = run_fixed(scene, 1.0, 2e-3, options("semi_implicit_euler"), own_step=True, error=error)
    true = rms(run.x[-1] - exact(scene, 1.0, 300))
    assert true / 1.5 < rms(error.x) < 1.5 * true


def test_derivatives_are_taken_half_way():
    scene, duration = cs.scenes.paper_swing(), 4e-3
    error = CarriedError(scene, 0.5, options())
    core, seen = error._field.core, []

    class Seen:
        def carry(self, x, v, *rest):
            seen.append((x, v))
            core.carry(x, v, *rest)

    begin = cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-4, 1000)
    middle, end = (cs.step(scene, *begin, 1e-4, steps) for steps in (20, 40))
    error._field.core = Seen()
    error._begin, error._passed = begin, duration
    error._carry(end)
    assert rms(seen[0][0] - middle[0]) < 1e-7
    assert rms(seen[0][1] - middle[1]) < 1e-2 * rms(middle[1])


@pytest.mark.parametrize(
    "name, tolerance, most",
    [("swing", 5e-7, FACTOR), ("swing with bend", 5e-9, FACTOR), ("swing with bend", 5e-6, LIMITED)],
)
def test_the_estimate_of_a_run_with_error_control(name, tolerance, most):
    make, duration, steps = SCENES[name]
    scene = make()
    error = CarriedError(scene, duration, options())
    run = integrate(scene, duration, tolerance, options(), error=error)
    true = rms(run.x[-1] - exact(scene, duration, steps))
    assert true / FACTOR < rms(error.x) < most * true
    assert run.x.tobytes() == integrate(scene, duration, tolerance, options()).x.tobytes()


def test_what_the_estimate_costs_is_counted(monkeypatch):
    scene, duration = cs.scenes.paper_swing(bend=True), 0.1
    error = CarriedError(scene, duration, options())
    fields = error._field.core
    calls = []

    class Counted:
        def __getattr__(self, name):
            return getattr(fields, name)

        def carry(self, *arguments):
            calls.append(arguments[5])
            fields.carry(*arguments)

    error._field.core = Counted()
    integrate(scene, duration, 1e-8, options(), error=error)
    fine = error._fine.core.evaluations[0]
    assert fine > 0 and fine % 12 == 0
    assert error.evaluations == fine + sum(calls) + len(calls) + error._stiffest.evaluations


@pytest.mark.parametrize("threads", [2, 3])
def test_same_bits_for_any_number_of_threads(threads):
    scene = cs.scenes.paper_swing(bend=True)
    found = []
    for n in (1, threads):
        error = CarriedError(scene, 0.05, options(threads=n))
        integrate(scene, 0.05, 1e-8, options(threads=n), error=error)
        found.append(error.x)
    assert found[0].tobytes() == found[1].tobytes()
