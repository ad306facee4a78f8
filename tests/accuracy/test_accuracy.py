"""The trusted solution and the orders measured by it."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim.accuracy import solution

DURATION = 0.2


@pytest.fixture(scope="module")
def swing():
    """Return a small sheet that swings down, and its reference."""
    scene = cs.Scene(cs.Cloth((6, 7), mass=21.0, damping=20.0))
    return scene, cs.reference(scene, DURATION, every=0.1)


def test_reference_of_the_oscillator_is_the_closed_form():
    scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    truth = cs.reference(scene, 3.0, every=1.0)
    assert truth.t.tolist() == [0.0, 1.0, 2.0, 3.0]
    amplitude = (1.0 + 0.1) - 1.0
    for t, x, v in zip(truth.t, truth.x, truth.v):
        assert abs(x[0, 1, 0] - (1 + amplitude * math.cos(10 * t))) < 1e-15
        assert abs(v[0, 1, 0] + 10 * amplitude * math.sin(10 * t)) < 2e-14
    assert truth.error_bound["max"].shape == (4,)
    assert 0 < truth.error_bound["max"][-1] < 2e-14


def test_the_two_methods_agree_and_a_third_confirms(swing, oracle):
    scene, truth = swing
    assert truth.x.shape == (3, 6, 7, 3) and truth.t.tolist() == [0.0, 0.1, DURATION]
    assert truth.error_bound["max"][-1] < 1e-13
    assert truth.error_estimate["max"][-1] < 2e-15
    # SciPy over the oracle's own forces, rtol 1e-12.
    assert truth.error_of(oracle.solution(scene, DURATION))["max"] < 2e-11
    assert (truth.x[0] == scene.initial_position).all()


def test_the_bound_sees_a_wrong_kernel(swing, monkeypatch):
    """Compute by the second method with other forces: the difference says so."""
    scene, _ = swing
    heavier = scene.replace(cloth=scene.cloth.replace(stiffness=35_000.0 * (1 + 1e-9)))
    original = solution.solve_in_double
    monkeypatch.setattr(solution, "solve_in_double", lambda s, *rest: original(heavier, *rest))
    solution._cached_reference.cache_clear()
    assert cs.reference(scene, DURATION).error_bound["max"][-1] > 1e-12
    solution._cached_reference.cache_clear()


def test_a_solution_is_computed_once(monkeypatch):
    scene = cs.scenes.oscillator()
    calls = []
    original = solution.solve_in_double
    monkeypatch.setattr(
        solution, "solve_in_double", lambda *args: calls.append(args) or original(*args)
    )
    first, again = (cs.reference(cs.scenes.oscillator(), 0.31) for _ in range(2))
    assert len(calls) == 1 and np.array_equal(again.x, first.x)
    with pytest.raises(ValueError, match="read-only"):
        again.x[0] = 0.0
    assert not any(
        array.flags.writeable
        for array in (*again.error_bound.values(), *again.error_estimate.values())
    )
    for other, arguments in (
        (cs.scenes.oscillator(damping=1e-9), (0.31,)),
        (scene, (0.32,)),
        (scene, (0.31, 0.1)),
    ):
        cs.reference(other, *arguments)
    assert len(calls) == 4


def test_contact_is_refused_and_said_why():
    scene = cs.scenes.paper_static()
    with pytest.raises(ValueError, match=r"sphere responds after a step, at about 0\.22"):
        cs.reference(scene, 0.4)


def test_a_reference_goes_through_a_layer():
    """Compare the oracle's own law in 106 bits with the kernels, and with what a run tells."""
    cloth = cs.Cloth((5, 5), (0.4, 0.4), mass=0.3, stiffness=100.0, damping=0.1, pins=())
    ball = cs.Sphere((0.2, -0.25, 0.2), 0.2, friction=0.2, slip_speed=0.1)
    scene = cs.Scene(cloth, ball)
    right = cs.reference(scene, 0.3)
    run = cs.simulate(scene, 0.3, rtol=1e-8)
    assert run.report["first_contact"]["time"] < 0.1
    assert right.error_bound["rms"][-1] < 1e-11
    assert right.error_of(run.x[-1])["rms"] < 2 * run.report["error_estimate"]["rms"] < 1e-8


def test_a_sphere_out_of_reach_changes_nothing(swing):
    scene, truth = swing
    sphere = cs.Sphere(
        (0.5, -3.0, 0.5), 0.25, motion=cs.Linear((0.0, 1.0, 0.0)), response="ray", offset="edge"
    )
    other = cs.reference(
        scene.replace(spheres=[sphere, cs.Plane((0, -9, 0), response="ray")]), DURATION
    )
    assert abs(other.x[-1] - truth.x[-1]).max() < 2e-15  # one had a frame on the way
    assert other.scene.spheres[0] == sphere
    with pytest.raises(ValueError, match="responds after a step"):
        fast = sphere.replace(motion=cs.Linear((0, 80.0, 0)))
        cs.reference(scene.replace(spheres=fast), DURATION)


def test_forces_that_are_not_smooth_are_an_error_that_names_the_time():
    """Let a point fall through another: the spring turns round at once."""
    cloth = cs.Cloth((1, 2), (1.0, 1.0), mass=2.0, stiffness=100.0, damping=0.0, pins=[(0, 0)])
    position = np.array([[[0.0, 0.0, 0.0], [2.5, 0.0, 0.0]]])  # at 1 + 1.5 cos(10 t)
    meets = math.acos(-1 / 1.5) / 10
    with pytest.raises(ArithmeticError, match=f"no reference: .* t = {meets:.6g}"):
        cs.reference(cs.Scene(cloth, gravity=(0, 0, 0), position=position), 2 * meets)


def test_a_pulse_shorter_than_a_step_leaves_the_bound_at_rounding():
    """Halve its one step too, without which the bound is 5e-12 m."""
    times = np.array([0, 0.5, 0.501, 0.502, 1.0])
    pull = cs.Keyframes(times, offsets=np.outer(times == 0.501, (0.05, 0, 0)))
    pins = {(row, 0): pull for row in range(4)}
    cloth = cs.Cloth((4, 4), (0.3, 0.3), mass=0.16, stiffness=1.0, damping=0.0, pins=pins)
    truth = cs.reference(cs.Scene(cloth, gravity=(0, 0, 0)), 1.0)
    assert truth.error_bound["max"][-1] < 1e-14


def test_threads_do_not_change_its_bits(monkeypatch, swing):
    scene, truth = swing
    for threads in (2, 5):
        monkeypatch.setattr(solution, "available_thread_count", lambda threads=threads: threads)
        solution._cached_reference.cache_clear()
        assert np.array_equal(cs.reference(scene, DURATION, every=0.1).x, truth.x)


def test_error_of():
    scene = cs.scenes.oscillator()
    truth = cs.reference(scene, 0.5, every=0.25)
    x = truth.x[1].copy()
    x[0, 1] += (3e-3, 0.0, 4e-3)
    error = truth.error_of(x, frame=1)
    assert error["max"] == pytest.approx(5e-3, rel=1e-12, abs=0)
    assert error["rms"] == pytest.approx(5e-3 / math.sqrt(2), rel=1e-12, abs=0)
    with pytest.raises(ValueError, match="shape"):
        truth.error_of(truth.x)


@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler", "dop853"])
def test_convergence_shows_the_order(integrator):
    scene = cs.scenes.oscillator(damping=2.0)
    dts = [(4 if integrator == "dop853" else 1) * 0.02 / 2 ** (k / 2) for k in range(6)]
    errors = cs.convergence(scene, 1.0, dts, integrator=integrator)
    assert errors.fitted.sum() >= 4
    assert abs(errors.order - cs.integrators()[integrator].order) < 0.15
    assert (np.diff(errors.dt) < 0).all() and (errors.steps * errors.dt).tolist() == [1.0] * 6
    exact = 1 + 0.1 * math.exp(-1.0) * (
        math.cos(math.sqrt(99)) + math.sin(math.sqrt(99)) / math.sqrt(99)
    )
    x, _ = cs.step(
        scene,
        scene.initial_position,
        scene.initial_velocity,
        errors.dt[0],
        int(errors.steps[0]),
        integrator=integrator,
    )
    assert errors.max[0] == pytest.approx(abs(x[0, 1, 0] - exact), rel=1e-6, abs=1e-15)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_convergence_fits_errors_between_rounding_and_instability(swing):
    scene, truth = swing
    dts = [1e-2, 1e-3, 5e-4, 2.5e-4, 5e-6, 2.5e-6]
    result = cs.convergence(scene, DURATION, dts, reference=truth)
    assert result.rms[0] == math.inf  # above the stability limit
    assert result.fitted.tolist() == [False, True, True, True, False, False]
    assert abs(result.order - 4) < 0.15
    assert "order 4.0" in str(result) and str(result).count("*") == 4
    single = cs.convergence(scene, DURATION, dts[3:], precision="single", reference=truth)
    assert math.isnan(single.order) and (single.floor > 1e-9).all() and (single.floor < 1e-7).all()
    assert str(single).startswith("rk4, single: no order")


def test_steps_are_shortened_to_divide_the_duration():
    result = cs.convergence(cs.scenes.oscillator(), 1.0, [0.3, 0.3, 0.1])
    assert result.steps.tolist() == [4, 10] and result.dt.tolist() == [0.25, 0.1]
