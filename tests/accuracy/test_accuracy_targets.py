"""The errors asked of the paper's swing with bend springs, against the trusted solution."""

import clothsim as cs
import numpy as np
import pytest

# Largest distance of a mass point from the reference [m] at a time [s], RK4 in double, dt = 5e-5 s.
DOUBLE = {0.25: 5e-12, 0.5: 5e-11, 1.0: 5e-10}


@pytest.fixture(scope="module")
def solution():
    return cs.reference(cs.scenes.paper_swing(bend=True), 1.0, every=0.25)


@pytest.mark.slow
def test_the_reference_is_more_accurate_than_the_runs_it_judges(solution):
    """What it is likely wrong by is far below the targets; its bound, which is the rounding of the
    second method in double, is below them too.
    """
    bound = dict(zip(solution.t.tolist(), solution.error_bound["max"], strict=True))
    estimate = dict(zip(solution.t.tolist(), solution.error_estimate["max"], strict=True))
    for t, target in DOUBLE.items():
        assert bound[t] < target
        assert estimate[t] < target / 10


def test_double_at_50_microseconds_beside_a_method_of_order_8():
    """At 0.25 s; against the trusted solution, and to 1 s, among the slow tests."""
    scene = cs.scenes.paper_swing(bend=True)
    state = scene.initial_position, scene.initial_velocity
    x, _ = cs.step(scene, *state, 5e-5, 5_000)
    better, _ = cs.step(scene, *state, 2.5e-4, 1_000, integrator="dop853", kernel="gather")
    assert np.linalg.norm(x - better, axis=-1).max() <= DOUBLE[0.25]


@pytest.mark.slow
def test_double_at_50_microseconds(solution):
    stepper = cs.Stepper(solution.scene, kernel="edge")
    for frame, t in enumerate(solution.t):
        stepper.advance(round((t - stepper.time) / 5e-5), 5e-5)
        if t in DOUBLE:
            assert solution.error_of(stepper.positions, frame)["max"] <= DOUBLE[t]


@pytest.mark.slow
def test_single_at_the_step_of_the_paper(solution):
    run = cs.simulate(solution.scene, 0.25, 5e-6, precision="single")
    error = solution.error_of(run.x[-1], frame=1)
    assert run.report["steps"] == 50_000
    assert error["max"] <= 1e-7


@pytest.mark.parametrize("step", [5e-6, 2.5e-7])
def test_single_after_a_million_steps_of_the_oscillator(step):
    """Rounding does not add up: a million steps in single err by an ulp or two of the position."""
    scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
    x, _ = cs.step(
        scene, scene.initial_position, scene.initial_velocity, step, 1_000_000, precision="single"
    )
    exact = 1.0 + 0.1 * np.cos(10.0 * step * 1_000_000)
    assert abs(x[0, 1, 0] - exact) <= 2e-7


@pytest.mark.slow
def test_single_after_a_million_steps_of_the_swing(solution):
    """The paper's swing over 0.25 s in a million steps."""
    run = cs.simulate(solution.scene, 0.25, 2.5e-7, precision="single")
    assert run.report["steps"] == 1_000_000
    assert solution.error_of(run.x[-1], frame=1)["max"] <= 2e-7
