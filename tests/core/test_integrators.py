"""Every integrator: its order, its stability as the table tells it, its bits, and what it conserves."""

import math
import re
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest
from clothsim.methods.amplification import amplification, amplification_matrix
from clothsim.methods.data import ALIASES, METHODS
from clothsim.methods.region import box_limit
from variants import NAMED_KERNELS, pairs

INTEGRATORS = tuple(cs.integrators())
EXPLICIT = [name for name in INTEGRATORS if cs.integrators()[name].explicit]
OSCILLATOR = {"stiffness": 100.0, "mass": 1.0, "amplitude": 0.1}

BOUNDED = [name for name in EXPLICIT if cs.integrators()[name].imaginary_limit > 0]

# Time steps a second, by order, in which the error of the order shows: below, the next order adds to it, above,
# rounding does.
COUNTS = {1: (4096, 8192, 16384), 2: (256, 512, 1024), 4: (64, 96, 128), 5: (128, 192, 256), 8: (16, 20, 24, 28)}


def oscillation(t, stiffness, mass, amplitude, damping):
    """x and v of the damped oscillator."""
    w, g = math.sqrt(stiffness / mass), damping / (2 * mass)
    u = math.sqrt(w * w - g * g)
    decay = amplitude * math.exp(-g * t)
    x = 1.0 + decay * (math.cos(u * t) + g / u * math.sin(u * t))
    return x, -decay * (u + g * g / u) * math.sin(u * t)


@pairs(integrator=INTEGRATORS, damping=[0.0, 3.0], kernel=NAMED_KERNELS)
def test_order(integrator, damping, kernel):
    method = cs.integrators()[integrator]
    scene = cs.scenes.oscillator(**OSCILLATOR, damping=damping)
    exact = oscillation(1.0, **OSCILLATOR, damping=damping)
    state = scene.initial_position, scene.initial_velocity
    counts, errors = np.array(COUNTS[method.order]), []
    for n in counts:
        x, v = cs.step(scene, *state, 1 / n, int(n), integrator=integrator, kernel=kernel)
        errors.append(math.hypot(10 * (x[0, 1, 0] - exact[0]), v[0, 1, 0] - exact[1]))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(order - method.order_of(scene)) < 0.15


@pytest.mark.parametrize("integrator", [n for n in INTEGRATORS if n != "dop853"])
def test_order_on_a_cloth(integrator, crumpled, oracle):
    """A cloth with every kind of spring, mass per point and damping, against another code."""
    method = cs.integrators()[integrator]
    damping = "springs" if method.damped else "nothing"
    scene, x, v, dt = crumpled(shape=(8, 9), damped_by=damping)
    scene = cs.Scene(scene.cloth, gravity=scene.gravity, position=x, velocity=v)
    # The first-order method shows its order on less of the motion and with smaller steps.
    duration = (2 if method.order == 1 else 8) * dt
    exact = oracle.solution(scene, duration)
    first = {1: 64, 2: 32, 4: 48, 5: 12}[method.order]
    counts, errors = np.array([first, 3 * first // 2, 2 * first]), []
    for n in counts:
        result, _ = cs.step(scene, x, v, duration / n, int(n), integrator=integrator)
        errors.append(np.abs(result - exact).max())
    assert abs(-np.polyfit(np.log(counts), np.log(errors), 1)[0] - method.order) < 0.15


@pytest.mark.parametrize("model", ["springs", "points", "both"])
def test_dop853_on_a_cloth(model, kernel, crumpled, oracle):
    scene, x, v, dt = crumpled(shape=(8, 9), damped_by=model)
    scene = cs.Scene(scene.cloth, gravity=scene.gravity, position=x, velocity=v)
    exact = oracle.solution(scene, 16 * dt)
    result, _ = cs.step(scene, x, v, dt / 2, 32, integrator="dop853", kernel=kernel)
    assert np.abs(result - exact).max() < 3e-13


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_amplification_matrix_is_that_of_a_step(integrator):
    """The oscillator's only spring lies along x, so a step of it is linear."""
    for omega, delta in [(0.7, 0.0), (1.3, 0.4), (0.2, 1.1)]:
        check_amplification(integrator, omega, delta)


def check_amplification(integrator, omega, delta):
    damping = delta * 1.0
    scene = cs.scenes.oscillator(stiffness=omega**2, mass=1.0, damping=damping)
    matrix = np.empty((2, 2))
    for column, (dx, dv) in enumerate([(0.25, 0.0), (0.0, 0.25)]):
        x, v = np.array([[[0.0] * 3, [1 + dx, 0, 0]]]), np.array([[[0.0] * 3, [dv, 0, 0]]])
        x, v = cs.step(scene, x, v, 1.0, integrator=integrator)
        matrix[:, column] = (x[0, 1, 0] - 1) / 0.25, v[0, 1, 0] / 0.25
    expected = amplification_matrix(integrator, omega, delta)
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=4e-15)


@pytest.mark.parametrize("integrator", EXPLICIT)
def test_the_limits_of_the_table(integrator):
    method = cs.integrators()[integrator]
    part = np.linspace(0, 1, 2001)
    assert amplification(integrator, part * method.imaginary_limit, 0.0).max() < 1 + 1e-9
    assert amplification(integrator, max(1.002 * method.imaginary_limit, 1e-3), 0.0) > 1 + 1e-7
    assert amplification(integrator, 0.0, part * method.real_limit).max() < 1 + 1e-6
    assert amplification(integrator, 0.0, 1.002 * method.real_limit) > 1.001


def test_the_implicit_method_has_no_limit():
    grid = np.logspace(-3, 6, 19)
    assert amplification("implicit_midpoint", grid[:, None], grid).max() <= 1 + 1e-12
    assert box_limit("implicit_midpoint", 1e9, 1e9) == math.inf


@pytest.mark.parametrize("integrator", BOUNDED)
def test_everything_below_the_guaranteed_step_is_stable(integrator):
    part = np.linspace(0, 1, 101)
    beyond = 1.02 * part
    for omega, delta in [*((10.0, ratio) for ratio in (0.0, 1e-5, 0.3, 1.0, 3.0, 10.0, 30.0, 1e3)), (0.0, 7.0)]:
        # A hair below: at the border two eigenvalues meet, and rounding counts by its root.
        dt = (1 - 1e-6) * box_limit(integrator, omega, delta)
        grid = amplification(integrator, part[:, None] * omega * dt, part * delta * dt)
        assert grid.max() <= 1 + 1e-6
        assert amplification(integrator, beyond[:, None] * omega * dt, beyond * delta * dt).max() > 1 + 1e-7


@pytest.mark.parametrize("integrator", EXPLICIT)
def test_strict_has_the_same_bits_on_every_instruction_set(integrator, crumpled, monkeypatch, same_bits):
    scene, x, v, dt = crumpled()
    results = []
    for name in cs.build_config()["instruction_sets_supported"]:
        monkeypatch.setenv("CLOTHSIM_ISA", name)
        results.append(cs.step(scene, x, v, dt, 5, integrator=integrator, strict=True))
    assert all(same_bits(result, results[0]) for result in results)


@pytest.mark.parametrize("integrator", EXPLICIT)
def test_single_does_not_stall(integrator):
    """Compensated: what is left is the rounding of the forces, 4e-8 here in every method."""
    scene = cs.scenes.paper_swing(bend=True)
    state = scene.initial_position, scene.initial_velocity
    steps = 1000
    x, _ = cs.step(scene, *state, 0.01 / steps, steps, integrator=integrator, precision="single")
    y, _ = cs.step(scene, *state, 0.01 / steps, steps, integrator=integrator)
    assert np.abs(x - y).max() < 6e-8


@pytest.mark.parametrize("integrator", [n for n, m in cs.integrators().items() if m.symplectic])
def test_symplectic_methods_keep_the_energy(integrator):
    """No drift over 900 periods: what the error is after 30, it is after 900."""
    scene = cs.scenes.oscillator(**OSCILLATOR)
    dt, steps = 2 * math.pi / 10 / 40, 1200
    stepper = cs.Stepper(scene, integrator=integrator)
    worst = []
    for rounds in (1, 3 if integrator == "implicit_midpoint" else 30):
        error = []
        for _ in range(rounds):
            stepper.advance(steps - 1, dt)
            for _ in range(40):  # over a period, as the error swings with it
                stepper.advance(1, dt)
                now = cs.energy(scene, stepper.positions, stepper.velocities)["total"]
                error.append(abs(now / 0.5 - 1))
        worst.append(max(error))
    assert worst[1] < 1.02 * worst[0] + 1e-10


def test_rk4_does_lose_energy():
    scene = cs.scenes.oscillator(**OSCILLATOR)
    stepper = cs.Stepper(scene)
    stepper.advance(40 * 3000, 2 * math.pi / 10 / 40)
    # |R(i z)|^2 = 1 - z^6 / 72 + ... with z = omega dt
    expected = 0.5 * math.exp(-40 * 3000 * (2 * math.pi / 40) ** 6 / 72)
    total = cs.energy(scene, stepper.positions, stepper.velocities)["total"]
    assert abs(total - expected) < 1e-4


@pytest.mark.parametrize("integrator", [n for n in EXPLICIT if not METHODS[n].in_kernels])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_evaluations_are_those_of_the_table(integrator, damping):
    stepper = cs.Stepper(cs.scenes.oscillator(damping=damping), integrator=integrator)
    stepper.advance(1, 1e-3)
    (before,) = stepper._state.core.evaluations
    stepper.advance(10, 1e-3)
    (after,) = stepper._state.core.evaluations
    method = cs.integrators()[integrator]
    assert after - before == 10 * method.evaluations_per_step(damping > 0)


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


@pytest.mark.parametrize("integrator", BOUNDED)
def test_unstable_names_the_limit_of_the_integrator(integrator):
    scene = cs.scenes.paper_swing(bend=True)
    limit = cs.max_stable_dt(scene, integrator)
    with pytest.raises(cs.UnstableError) as caught:
        cs.step(scene, scene.initial_position, scene.initial_velocity, 6 * limit, 3000, integrator=integrator)
    assert caught.value.max_stable_dt == limit
    assert np.isfinite(caught.value.x).all()
    x, _ = cs.step(scene, scene.initial_position, scene.initial_velocity, limit, 300, integrator=integrator)
    assert np.abs(x).max() < 2


def test_the_table_is_read_only():
    with pytest.raises(TypeError):
        cs.integrators()["mine"] = None
    with pytest.raises(AttributeError):
        cs.integrators()["rk4"].order = 5


def test_parts_of_a_step_are_checked():
    with pytest.raises(ValueError, match="omega_dt must be finite numbers >= 0"):
        amplification("rk4", [-1.0], 0.0)
    with pytest.raises(TypeError, match="delta_dt"):
        amplification("rk4", 1.0, "much")


@pytest.mark.parametrize(
    ("alias", "name"),
    [
        ("RK4", "rk4"),
        ("rk45", "dopri5"),
        ("RK45", "dopri5"),
        ("DOP853", "dop853"),
        ("Forward Euler", "explicit_euler"),
        ("Semi-Implicit Euler", "semi_implicit_euler"),
        ("verlet", "velocity_verlet"),
        ("leapfrog", "velocity_verlet"),
    ],
)
def test_other_names_of_a_method_are_taken_everywhere(alias, name, same_bits):
    scene = cs.scenes.oscillator(damping=1.0)
    state = scene.initial_position, scene.initial_velocity
    assert same_bits(cs.step(scene, *state, 1e-3, integrator=alias), cs.step(scene, *state, 1e-3, integrator=name))
    stepper = cs.Stepper(scene, integrator=alias)
    stepper.advance(steps=1, dt=1e-3)
    again = cs.Stepper.restore(stepper.snapshot())
    again.advance(steps=1, dt=1e-3)
    assert cs.simulate(scene, 1e-3, dt=1e-3, integrator=alias).report["integrator"] == name
    assert cs.max_stable_dt(scene, alias) == cs.max_stable_dt(scene, name)
    assert cs.convergence(scene, 0.1, [0.01], alias).integrator == name
    assert amplification(alias, 1.0, 0.5) == amplification(name, 1.0, 0.5)
    swept = cs.sweep(scene, {"integrator": [alias, "pefrl"]}, duration=1e-3, dt=1e-3, progress=False)
    assert swept.integrator.values.tolist() == [name, "pefrl"] and swept.stable.all()
    one = cs.sweep(scene, integrator=alias, duration=1e-3, dt=1e-3, progress=False)
    assert one.clothsim.provenance["identity"]["settings"]["integrator"] == name
    work = cs.work_precision(scene, 0.1, [alias], precisions=["double"], dts=[0.01], windows=1)
    assert work.integrator.values.tolist() == [name]


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("euler", "did you mean 'explicit_euler' or 'semi_implicit_euler'"),
        ("midpoint", "did you mean 'implicit_midpoint'"),
        ("rk5", r"must be one of .*'dop853'.* \(did you mean 'rk4'\?\)"),
        ("forest_ruth", "must be one of .*'pefrl'"),
    ],
)
def test_a_name_of_another_method_is_refused_with_the_nearest(name, nearest):
    with pytest.raises(ValueError, match=nearest):
        cs.Stepper(cs.scenes.oscillator(), integrator=name)


def test_adaptive_methods_have_other_names_too():
    scene = cs.scenes.oscillator()
    assert cs.simulate(scene, 0.1, rtol=1e-6, integrator="RK45").report["integrator"] == "dopri5"
    assert cs.simulate(scene, 0.1, rtol=1e-6, integrator="AUTO").report["steps"] > 0
    work = cs.work_precision(scene, 0.1, ["RK45 adaptive"], precisions=["double"], rtols=[1e-3], windows=1)
    assert work.solver.values.tolist() == ["dopri5 adaptive double"]
    with pytest.raises(ValueError, match="methods must be"):
        cs.work_precision(scene, 0.1, ["rk4 adaptive"])


def test_the_docs_have_every_other_name():
    text = (Path(__file__).parents[2] / "docs" / "integrators.md").read_text(encoding="utf-8")
    for alias, name in ALIASES.items():
        assert re.search(rf"^\| .*`{alias}`.* \| `{name}` \|$", text, re.M), alias


def test_the_theory_takes_the_coefficients_of_the_core():
    """Dormand and Prince's further term is 1/600; the counts are those of the coefficients that are not 0."""
    assert METHODS["rk4"].terms == pytest.approx((1, 1, 1 / 2, 1 / 6, 1 / 24), rel=1e-15)
    assert METHODS["explicit_euler"].terms == (1.0, 1.0)
    assert METHODS["dopri5"].terms[6:] == pytest.approx((1 / 600,), rel=1e-14, abs=0)
    known = (2.6916922001690827e-06, 2.3413451082097813e-07, 1.494736485459155e-08, 3.6133245781282443e-10)
    assert METHODS["dop853"].terms[9:] == pytest.approx(known, rel=1e-12, abs=0)
    counts = {
        "explicit_euler": (2, 2),
        "semi_implicit_euler": (2, 2),
        "velocity_verlet": (3, 7),  # 3 in the damped stage, 4 in its result
        "pefrl": (9, 9),
        "dopri5": (40, 40),
        "dop853": (125, 125),
        "implicit_midpoint": (None, None),
    }
    assert {name: method.updates for name, method in METHODS.items() if not method.in_kernels} == counts


def test_the_limits_are_those_of_the_literature():
    limits = {name: (one.imaginary_limit, one.real_limit) for name, one in cs.integrators().items()}
    assert limits["rk4"] == pytest.approx((math.sqrt(8), 2.785293563405282), rel=1e-8)
    assert limits["explicit_euler"] == (0.0, pytest.approx(2.0, rel=1e-8))
    assert limits["semi_implicit_euler"] == pytest.approx((2.0, 2.0), rel=1e-8)
    assert limits["velocity_verlet"] == pytest.approx((2.0, 2.0), rel=1e-8)
    assert limits["dopri5"] == pytest.approx((0.9971, 3.3065), rel=1e-4)
    assert limits["implicit_midpoint"] == (math.inf, math.inf)


# Explicit Euler, which has no stable time step where nothing damps


def test_explicit_euler_adds_the_energy_that_theory_says():
    """|1 + i z|^2 = 1 + z^2 with z = omega dt."""
    scene = cs.scenes.oscillator(**OSCILLATOR)
    stepper = cs.Stepper(scene, integrator="explicit_euler")
    stepper.advance(400, 1e-3)
    total = cs.energy(scene, stepper.positions, stepper.velocities)["total"]
    assert total == pytest.approx(0.5 * (1 + 1e-4) ** 400, rel=1e-12)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_explicit_euler_is_its_formula_on_a_cloth(threads, kernel, crumpled):
    scene, x, v, dt = crumpled(shape=(9, 20))
    found = cs.step(scene, x, v, dt, 5, integrator="explicit_euler", threads=threads, kernel=kernel)
    for _ in range(5):
        x, v = x + dt * v, v + dt * cs.acceleration(scene, x, v)
    for one, expected in zip(found, (x, v)):
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_explicit_euler_says_why_no_step_is_stable():
    scene = cs.scenes.paper_swing()
    assert cs.max_stable_dt(scene, "explicit_euler") == 0.0
    explained = scene.explain(integrator="explicit_euler")
    assert explained["max_stable_dt"] == 0.0
    cause = "explicit_euler amplifies undamped motion at every time step"
    assert explained["limited_by"] == cause
    for call in (
        lambda: cs.simulate(scene, 0.1, integrator="explicit_euler"),
        lambda: cs.sweep(scene, {"stiffness": [1e3]}, duration=0.1, integrator="explicit_euler", progress=False),
    ):
        with pytest.raises(ValueError, match="dt must be given with integrator 'explicit_euler', which has no stable"):
            call()
    with pytest.warns(cs.StabilityWarning, match=cause), pytest.raises(cs.UnstableError, match=cause):
        cs.simulate(scene, 1.0, dt=2e-3, integrator="explicit_euler")


def test_drag_on_every_point_gives_explicit_euler_a_step_at_a_state():
    """x'' = -omega^2 x - delta x' is stable up to delta / omega^2."""
    cloth = cs.Cloth((1, 2), (1.0, 1.0), mass=2.0, stiffness=100.0, damping=0.0, drag=0.5, pins=((0, 0),))
    scene = cs.Scene(cloth, gravity=(0, 0, 0))
    found = cs.max_stable_dt(scene, "explicit_euler", scene.initial_position)
    assert found == pytest.approx(0.97 * 0.5 / 100, rel=1e-4)
    assert cs.max_stable_dt(cs.scenes.oscillator(), "explicit_euler", cs.scenes.oscillator().initial_position) == 0.0
