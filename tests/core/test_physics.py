"""What mechanics says without knowing the code: solutions, conserved quantities, symmetries."""

import math

import clothsim as cs
import numpy as np
import pytest
from tables import each
from variants import cases

G = np.array([0.0, -9.80665, 0.0])


def test_free_fall(variant):
    """A rigidly moving sheet: RK4 is exact for the parabola."""
    cloth = cs.Cloth((9, 20), damping=0.0, pins=())
    scene = cs.Scene(cloth)
    x, u, t = cloth.rest_positions, np.array([0.3, 1.7, -0.4]), 0.05
    xt, vt = cs.step(scene, x, np.broadcast_to(u, x.shape), t / 100, 100, **variant.options)
    bound = {"double": 1e-13, "single": 1e-6}[variant.precision]
    assert np.abs(xt - (x + u * t + G * t**2 / 2)).max() < bound
    assert np.abs(vt - (u + G * t)).max() < 100 * bound


@cases()
@each("shape", [(6, 7), (9, 20), (12, 33), (20, 32), (8, 80)])
def test_a_cloth_without_springs_falls_freely(variant, shape):
    cloth = cs.Cloth(shape, springs=(), pins=(), damping=0.0)
    scene = cs.Scene(cloth, gravity=(0.5, -9.80665, 0.25))
    x = cloth.rest_positions
    v = np.random.default_rng(0).uniform(-1, 1, x.shape)
    dt, steps = 1e-2, 20
    t, g = dt * steps, np.array(scene.gravity)
    for threads in (1, 2):
        end, w = cs.step(scene, x, v, dt, steps, **variant.options | {"threads": threads})
        rounding = 1e-14 if variant.precision == "double" else 1e-6
        assert np.abs(w - (v + g * t)).max() < rounding
        assert np.abs(end - (x + v * t + g * t**2 / 2)).max() < rounding


@each("damping", [0.0, 2.0])
def test_two_point_oscillator(variant, damping):
    scene = cs.scenes.oscillator(100.0, 1.0, 0.1, 1.0, damping)
    g = damping / 2
    u = math.sqrt(100.0 - g * g)
    x, v = scene.initial_position, scene.initial_velocity
    for k in range(1, 5):
        x, v = cs.step(scene, x, v, 1e-3, 250, **variant.options)
        t = 0.25 * k
        wave = math.exp(-g * t) * (math.cos(u * t) + g / u * math.sin(u * t))
        bound = {"double": 1e-10, "single": 1e-7}[variant.precision]
        assert abs(x[0, 1, 0] - (1 + 0.1 * wave)) < bound


@each("shape", [(16, 1), (16, 16), (5, 19)])
def test_hanging_sheet_comes_to_its_static_solution(variant, shape):
    scene = cs.scenes.hanging(shape, mass=0.01 * shape[0] * shape[1])
    state = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, *state, 2e-3, 2000, **variant.options)
    rows = shape[0]
    row = np.arange(rows)
    sag = 0.01 * 9.80665 / 1000 * row * (2 * rows - row - 1) / 2
    y = -row / (rows - 1) - sag
    bound = {"double": 1e-12, "single": 1e-6}[variant.precision]
    assert np.abs(x[..., 1] - y[:, None]).max() < bound
    assert np.abs(x[..., [0, 2]] - scene.initial_position[..., [0, 2]]).max() < bound


@cases()
@each("shape", [(17, 17), (9, 33), (2, 1), (1, 5)])
def test_a_sheet_at_rest_stays_at_rest(variant, shape):
    """Exactly in double and in the gather kernel: rest lengths are rounded like lengths of springs.

    The edge kernel in single: the length is l^2 times a rounded 1/l, which differs from the rest length by one
    unit in the last place (by up to three with AVX2's estimate).
    """
    rows, columns = shape
    cloth = cs.Cloth(shape, size=((rows - 1) / 16 or 1, (columns - 1) / 16 or 1), pins=())
    x, v = cloth.rest_positions, np.zeros((*shape, 3))
    after = cs.step(cs.Scene(cloth, gravity=(0, 0, 0)), x, v, 5e-4, 1000, **variant.options)
    if variant.kernel == "gather" or variant.precision == "double":
        np.testing.assert_array_equal(after[0], x)
        np.testing.assert_array_equal(after[1], v)
        return
    assert np.abs(after[0] - x).max() < 3 * 2.0**-24
    assert np.abs(after[1]).max() < 300 * 2.0**-24


@pytest.mark.parametrize("mass", ["uniform", "per point"])
def test_momentum_is_conserved(double_variant, crumpled, mass):
    scene, x, v, dt = crumpled(pins=(), gravity=(0, 0, 0), mass=mass)
    m = scene.cloth.mass_per_point[..., None]
    xt, vt = cs.step(scene, x, v, dt, 500, **double_variant.options)
    total = np.abs(m * v).sum()
    assert np.abs((m * (vt - v)).sum(axis=(0, 1))).max() < 1e-12 * total
    drift = (m * (xt - x)).sum(axis=(0, 1)) - 500 * dt * (m * v).sum(axis=(0, 1))
    assert np.abs(drift).max() < 1e-12 * total * max(1.0, 500 * dt)


@each("model", ["springs", "points", "both"])
def test_damping_only_takes_energy(variant, crumpled, model):
    scene, x, v, dt = crumpled(damped_by=model)
    stepper = cs.Stepper(scene, x, v, **variant.options)
    totals = [cs.energy(scene, stepper.positions, stepper.velocities)["total"]]
    for _ in range(100):
        stepper.advance(1, dt)
        totals.append(cs.energy(scene, stepper.positions, stepper.velocities)["total"])
    assert (np.diff(totals) < 0).all()
    spent = totals[0] - totals[-1]
    assert spent > 0.05 * cs.energy(scene, x, v)["kinetic"]


@pytest.mark.parametrize("model", ["springs", "points", "both"])
def test_damping_takes_the_power_it_should(double_variant, crumpled, model):
    """dE/dt = - sum c ((v_i - v_j) . n)^2, or - sum c v^2."""
    scene, x, v, _ = crumpled(damped_by=model)
    cloth = scene.cloth
    h = 1e-6
    before, after = (cs.energy(scene, *cs.step(scene, x, v, h, 1 + k, **double_variant.options))["total"] for k in (0, 2))
    x, v = cs.step(scene, x, v, h, 2, **double_variant.options)
    table = cloth.spring_table()
    flat_x, flat_v = x.reshape(-1, 3), v.reshape(-1, 3)
    d = flat_x[table["j"]] - flat_x[table["i"]]
    n = d / np.linalg.norm(d, axis=1)[:, None]
    rate = ((flat_v[table["j"]] - flat_v[table["i"]]) * n).sum(axis=1)
    power = (table["damping"] * rate**2).sum() + cloth.drag * (v**2).sum()
    np.testing.assert_allclose((before - after) / (2 * h), power, rtol=1e-6)


def test_energy_is_kept_without_damping(double_variant, crumpled):
    """To the order of the method: the drift falls 32-fold with half the time step."""
    scene, x, v, dt = crumpled(damped_by="nothing")
    start = cs.energy(scene, x, v)
    drifts = []
    for part in (8, 16):
        state = cs.step(scene, x, v, dt / part, 100 * part, **double_variant.options)
        end = cs.energy(scene, *state)
        assert end["kinetic"] > 2 * start["kinetic"]
        drifts.append((end["total"] - start["total"]) / start["kinetic"])
    assert abs(drifts[1]) < 2e-8
    assert 25 < drifts[0] / drifts[1] < 40
