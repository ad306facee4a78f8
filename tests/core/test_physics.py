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


def test_two_free_points_swing_about_their_centre_of_mass():
    """Unequal masses: w^2 = K (1/m1 + 1/m2), and the centre of mass stands still."""
    masses = np.array([[1.0, 3.0]])
    cloth = cs.Cloth((1, 2), mass=masses, stiffness=60.0, damping=0.0, springs=("structural",), pins=())
    x = cloth.rest_positions + np.array([[[0, 0, 0], [0.2, 0, 0]]])
    scene = cs.Scene(cloth, gravity=(0, 0, 0), position=x)
    t = 0.4
    xt, _ = cs.step(scene, x, 0 * x, t / 1000, 1000)
    w = math.sqrt(60.0 * (1 + 1 / 3))
    assert abs(xt[0, 1, 0] - xt[0, 0, 0] - (1 + 0.2 * math.cos(w * t))) < 1e-11
    assert abs((xt[0, :, 0] * masses[0]).sum() - 3 * 1.2) < 1e-13


def test_drag_slows_a_point_exponentially():
    cloth = cs.Cloth((2, 2), mass=8.0, stiffness=0.0, damping=0.0, drag=3.0, pins=())
    scene = cs.Scene(cloth, gravity=(0, 0, 0))
    v = np.full((2, 2, 3), 0.7)
    xt, vt = cs.step(scene, cloth.rest_positions, v, 1e-3, 500)
    rate = 3.0 / 2.0
    np.testing.assert_allclose(vt, 0.7 * math.exp(-rate * 0.5), rtol=1e-13)
    moved = 0.7 * (1 - math.exp(-rate * 0.5)) / rate
    np.testing.assert_allclose(xt - cloth.rest_positions, moved, rtol=1e-12)


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
    """Exactly in double and in the strict class: rest lengths are rounded like lengths of springs.

    Single, fused: the length is l^2 times a rounded 1/l, which differs from the rest length by one
    unit in the last place (by up to three with AVX2's estimate).
    """
    rows, columns = shape
    cloth = cs.Cloth(shape, size=((rows - 1) / 16 or 1, (columns - 1) / 16 or 1), pins=())
    x, v = cloth.rest_positions, np.zeros((*shape, 3))
    after = cs.step(cs.Scene(cloth, gravity=(0, 0, 0)), x, v, 5e-4, 1000, **variant.options)
    if variant.strict or variant.precision == "double":
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


def test_forces_have_no_torque(double_variant, crumpled):
    """Springs and their damping act along the line of their two ends."""
    scene, x, v, _ = crumpled(pins=(), gravity=(0, 0, 0))
    a = cs.acceleration(scene, x, v, **double_variant.options)
    torque = np.cross(x, scene.cloth.mass_per_point[..., None] * a)
    assert np.abs(torque.sum(axis=(0, 1))).max() < 1e-12 * np.abs(torque).sum()


def test_forces_are_the_same_in_a_turned_frame(double_variant, crumpled):
    scene, x, v, _ = crumpled(gravity=(0, 0, 0))
    turn, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    a = cs.acceleration(scene, x, v, **double_variant.options)
    turned = cs.acceleration(scene, x @ turn.T, v @ turn.T, **double_variant.options)
    assert np.abs(turned - a @ turn.T).max() < 1e-12 * np.abs(a).max()


def test_the_swing_keeps_its_mirror_symmetry(double_variant):
    """The plane z = 1/2 halves the sheet; its two halves do the same."""
    scene = cs.scenes.paper_swing()
    state = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, *state, 2.5e-4, 800, **double_variant.options)
    mirrored = x[::-1] * np.array([1, 1, -1]) + np.array([0, 0, 1])
    assert np.abs(x - mirrored).max() < 1e-13
    assert np.abs(v - v[::-1] * np.array([1, 1, -1])).max() < 1e-11


def test_a_mirrored_sheet_does_the_mirrored_motion(double_variant, crumpled, relative):
    """Rows and columns reversed: each neighbour takes the place of its opposite."""
    scene, x, v, dt = crumpled()
    cloth = scene.cloth
    turned = scene.replace(cloth=cloth.replace(mass=cloth.mass_per_point[::-1, ::-1], pins=cloth.pinned[::-1, ::-1]))
    there = cs.step(scene, x, v, dt, 100, **double_variant.options)
    back = cs.step(turned, x[::-1, ::-1], v[::-1, ::-1], dt, 100, **double_variant.options)
    assert relative([part[::-1, ::-1] for part in back], there, x) < 1e-12


def test_a_transposed_sheet_does_the_same_motion(double_variant, crumpled, relative):
    """Rows for columns: the families are symmetric in the two axes."""
    scene, x, v, dt = crumpled()
    cloth = scene.cloth
    turned = scene.replace(
        cloth=cloth.replace(shape=cloth.shape[::-1], size=cloth.size[::-1], mass=cloth.mass_per_point.T, pins=cloth.pinned.T)
    )
    there = cs.step(scene, x, v, dt, 100, **double_variant.options)
    back = cs.step(turned, x.swapaxes(0, 1), v.swapaxes(0, 1), dt, 100, **double_variant.options)
    assert relative([part.swapaxes(0, 1) for part in back], there, x) < 1e-12


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


def _scaled(scene, length=1.0, time=1.0, mass=1.0):
    cloth = scene.cloth
    force = mass * length / time**2
    return scene.replace(
        cloth=cloth.replace(
            size=tuple(s * length for s in cloth.size),
            mass=cloth.mass_per_point * mass,
            stiffness={f: k * force / length for f, k in cloth.family_stiffness.items()},
            damping={f: c * force / length * time for f, c in cloth.family_damping.items()},
        ),
        gravity=tuple(g * length / time**2 for g in scene.gravity),
        spheres=[s.replace(center=tuple(c * length for c in s.center), radius=s.radius * length) for s in scene.spheres],
    )


@cases()
def test_units_scaled_by_powers_of_two_give_the_same_bits(variant, crumpled):
    ball = cs.Sphere((0.6, -0.2, 0.4), 0.25, response="ray", offset="edge")
    scene, x, v, dt = crumpled(spheres=ball)
    xt, vt = cs.step(scene, x, v, dt, 100, **variant.options)
    for units in ({"length": 4.0}, {"time": 0.25}, {"mass": 8.0}, {"length": 0.5, "time": 2.0, "mass": 0.25}):
        length, time = units.get("length", 1.0), units.get("time", 1.0)
        xs, vs = cs.step(_scaled(scene, **units), x * length, v * (length / time), dt * time, 100, **variant.options)
        np.testing.assert_array_equal(xs, xt * length)
        np.testing.assert_array_equal(vs, vt * (length / time))
