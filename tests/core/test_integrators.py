"""Every integrator: its order, stability as the table tells it, bits, and what it conserves."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim.methods.integrators import METHODS
from clothsim.methods.region import amplification_matrix, stable_dt_of_box
from tables import each
from variants import FIXED, NAMED_KERNELS, pairs

EXPLICIT = [name for name in FIXED if METHODS[name].explicit]
OSCILLATOR = {"stiffness": 100.0, "mass": 1.0, "amplitude": 0.1}

BOUNDED = [name for name in EXPLICIT if cs.integrators()[name].imaginary_limit > 0]

# Time steps a second, by order, in which the error of the order shows: below, the next order adds
# to it, above, rounding does.
COUNTS = {
    1: (4096, 8192, 16384),
    2: (256, 512, 1024),
    4: (64, 96, 128),
    5: (128, 192, 256),
    8: (16, 20, 24, 28),
}


def oscillation(t, stiffness, mass, amplitude, damping):
    """Return x and v of the damped oscillator."""
    w = math.sqrt(stiffness / mass)
    g = damping / (2 * mass)
    u = math.sqrt(w * w - g * g)
    decay = amplitude * math.exp(-g * t)
    x = 1.0 + decay * (math.cos(u * t) + g / u * math.sin(u * t))
    return x, -decay * (u + g * g / u) * math.sin(u * t)


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pairs(integrator=FIXED, damping=[0.0, 3.0], kernel=NAMED_KERNELS)
def test_order(integrator, damping, kernel):
    method = cs.integrators()[integrator]
    scene = cs.scenes.oscillator(**OSCILLATOR, damping=damping)
    exact = oscillation(1.0, **OSCILLATOR, damping=damping)
    state = scene.initial_position, scene.initial_velocity
    counts = np.array(COUNTS[method.order])
    errors = []
    for n in counts:
        x, v = cs.step(scene, *state, 1 / n, int(n), integrator=integrator, kernel=kernel)
        errors.append(math.hypot(10 * (x[0, 1, 0] - exact[0]), v[0, 1, 0] - exact[1]))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(order - method.order_of(scene)) < 0.15


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", FIXED)
@each("omega, delta", [(0.7, 0.0), (1.3, 0.4), (0.2, 1.1)])
def test_the_amplification_matrix_is_that_of_a_step(integrator, omega, delta):
    """The oscillator's only spring lies along x, so a step of it is linear."""
    damping = delta * 1.0
    scene = cs.scenes.oscillator(stiffness=omega**2, mass=1.0, damping=damping)
    matrix = np.empty((2, 2))
    for column, (dx, dv) in enumerate([(0.25, 0.0), (0.0, 0.25)]):
        x, v = np.array([[[0.0] * 3, [1 + dx, 0, 0]]]), np.array([[[0.0] * 3, [dv, 0, 0]]])
        x, v = cs.step(scene, x, v, 1.0, integrator=integrator)
        matrix[:, column] = (x[0, 1, 0] - 1) / 0.25, v[0, 1, 0] / 0.25
    expected = amplification_matrix(integrator, omega, delta)
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=4e-15)
    if cs.integrators()[integrator].symplectic and delta == 0:
        assert np.linalg.det(matrix) == pytest.approx(1, rel=1e-14)


def amplification(*mode):
    return np.abs(np.linalg.eigvals(amplification_matrix(*mode))).max(axis=-1)


@pytest.mark.parametrize("integrator", BOUNDED)
def test_everything_below_the_guaranteed_step_is_stable(integrator):
    part = np.linspace(0, 1, 101)
    beyond = 1.02 * part
    for omega, delta in [
        *((10.0, ratio) for ratio in (0.0, 1e-5, 0.3, 1.0, 3.0, 10.0, 30.0, 1e3)),
        (0.0, 7.0),
    ]:
        # A hair below: at the border two eigenvalues meet, and rounding counts by its root.
        dt = (1 - 1e-6) * stable_dt_of_box(integrator, omega, delta)
        grid = amplification(integrator, part[:, None] * omega * dt, part * delta * dt)
        assert grid.max() <= 1 + 1e-6
        assert (
            amplification(integrator, beyond[:, None] * omega * dt, beyond * delta * dt).max()
            > 1 + 1e-7
        )


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", EXPLICIT)
def test_single_does_not_stall(integrator):
    """Compensated: what is left is the rounding of the forces, 4e-8 here in every method."""
    scene = cs.scenes.paper_swing(bend=True)
    state = scene.initial_position, scene.initial_velocity
    steps = 1000
    x, _ = cs.step(scene, *state, 0.01 / steps, steps, integrator=integrator, precision="single")
    y, _ = cs.step(scene, *state, 0.01 / steps, steps, integrator=integrator)
    assert np.abs(x - y).max() < 6e-8


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("integrator", [n for n in EXPLICIT if not METHODS[n].in_kernels])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_evaluations_are_those_of_the_table(integrator, damping):
    stepper = cs.Stepper(cs.scenes.oscillator(damping=damping), integrator=integrator)
    stepper.advance(1, 1e-3)
    (before,) = stepper._state.core.evaluations
    stepper.advance(10, 1e-3)
    (after,) = stepper._state.core.evaluations
    method = cs.integrators()[integrator]
    assert after - before == 10 * (method.stages_damped if damping else method.stages)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
def test_the_implicit_method_stands_huge_steps():
    """A hundred times the stable step of RK4: each step still solves the midpoint rule.

    The rule bounds the energy, it does not keep it: waves faster than the step are not followed.
    """
    scene = cs.Scene(cs.Cloth(shape=(12, 12), mass=14.4, stiffness=1e6, damping=1.0))
    dt = 100 * cs.max_stable_dt(scene)
    state = x, v = scene.initial_position, scene.initial_velocity
    for _ in range(10):
        x_new, v_new = cs.step(scene, x, v, dt, integrator="implicit_midpoint")
        middle = cs.acceleration(scene, (x + x_new) / 2, (v + v_new) / 2)
        np.testing.assert_allclose(x_new - x, dt * (v + v_new) / 2, rtol=0, atol=1e-12)
        scale = np.abs(middle).max()
        np.testing.assert_allclose((v_new - v) / dt, middle, rtol=0, atol=1e-8 * scale)
        x, v = x_new, v_new
    weight = 14.4 * 9.80665
    assert abs(cs.energy(scene, x, v)["total"] - cs.energy(scene, *state)["total"]) < weight / 4
    with pytest.raises(cs.UnstableError):
        cs.step(scene, *state, dt, 50, integrator="rk4")


@pytest.mark.parametrize("dt", [1e-3, 1e-2, 5e-2])
def test_newtons_method_ends_above_the_rounding_of_the_springs(dt):
    """Taut springs: the tension is a small difference of K l and K L, whose rounding remains."""
    scene = cs.scenes.hanging(shape=(16, 16))
    run = cs.simulate(scene, 20 * dt, dt=dt, integrator="implicit_midpoint")
    assert run.report["solution_evaluations"] <= 3 * run.report["steps"]


def test_the_limits_are_those_of_the_literature():
    limits = {
        name: (method.imaginary_limit, method.real_limit)
        for name, method in cs.integrators().items()
    }
    assert limits["rk4"] == pytest.approx((math.sqrt(8), 2.785293563405282), rel=1e-8)
    assert limits["explicit_euler"] == (0.0, pytest.approx(2.0, rel=1e-8))
    assert limits["semi_implicit_euler"] == pytest.approx((2.0, 2.0), rel=1e-8)
    assert limits["velocity_verlet"] == pytest.approx((2.0, 2.0), rel=1e-8)
    assert limits["dopri5"] == pytest.approx((0.9971, 3.3065), rel=1e-4)
    assert limits["implicit_midpoint"] == (math.inf, math.inf)


# Explicit Euler, which has no stable time step where nothing damps


def test_explicit_euler_says_why_no_step_is_stable():
    scene = cs.scenes.paper_swing()
    assert cs.max_stable_dt(scene, "explicit_euler") == 0.0
    explained = scene.explain(integrator="explicit_euler")
    assert explained["max_stable_dt"] == 0.0
    cause = "explicit_euler amplifies undamped motion at every time step"
    assert explained["limited_by"] == cause
    for call in (
        lambda: cs.simulate(scene, 0.1, integrator="explicit_euler"),
        lambda: cs.sweep(
            scene, {"stiffness": [1e3]}, duration=0.1, integrator="explicit_euler", progress=False
        ),
    ):
        with pytest.raises(
            ValueError,
            match="dt must be given with integrator 'explicit_euler', which has no stable",
        ):
            call()
    with (
        pytest.warns(cs.StabilityWarning, match=cause),
        pytest.raises(cs.UnstableError, match=cause),
    ):
        cs.simulate(scene, 1.0, dt=2e-3, integrator="explicit_euler")
