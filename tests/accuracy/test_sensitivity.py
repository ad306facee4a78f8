"""Derivatives of motions: against formulas and an independent integration, and NaN where they have
no meaning.
"""

import clothsim as cs
import numpy as np
import pytest
from clothsim.accuracy.sensitivity import Schedule, check_times

pytest.importorskip("xarray")
integrate = pytest.importorskip("scipy.integrate")

TIMES = np.linspace(0.1, 0.25, 4)
STIFFNESS = {"structural": 60.0, "shear": 25.0, "bend": 8.0}
CLOTH = cs.Cloth(
    (3, 4), (0.4, 0.5), 0.2, STIFFNESS, {"structural": 0.02, "shear": 0.01, "bend": 0.03}, 0.05
)
BUMPS = np.random.default_rng(1).normal(0, 0.01, (3, 4, 3)) * ~CLOTH.pinned[..., None]
SCENE = cs.Scene(CLOTH, position=CLOTH.rest_positions + BUMPS, force=np.full((3, 4, 3), 0.01))


def variational(scene, times, names):
    """Solve the variational equations: d x / d parameter, (names, times, rows, columns, 3)."""
    cloth, table = scene.cloth, scene.cloth.spring_table()
    n = cloth.rows * cloth.columns
    ends = np.eye(n)[table["j"]] - np.eye(n)[table["i"]]  # (springs, points)
    stiffness, damping, rest = (
        table[name][:, None] for name in ("stiffness", "damping", "rest_length")
    )
    mass, free = cloth.mass_per_point.reshape(n, 1), ~cloth.pinned.reshape(n, 1)

    kinds, families = np.array([(*name.partition("_")[::2],) for name in names]).T[..., None, None]
    of_family = families == table["family"][:, None]  # (names, springs, 1)
    up = (np.array(names) == "gravity_y")[:, None, None] * np.array([0, 1, 0])

    def along(a, b):
        return (a * b).sum(axis=-1, keepdims=True)

    def slope(_, y):
        x, v, dx, dv = *(y := y.reshape(1 + len(names), 2, n, 3))[0], y[1:, 0], y[1:, 1]
        d, w, dd, dw = ends @ x, ends @ v, ends @ dx, ends @ dv
        length = np.linalg.norm(d, axis=1, keepdims=True)
        u = d / length
        du = (dd - u * along(u, dd)) / length
        pull = stiffness * (length - rest) + damping * along(w, u)
        total = -ends.T @ (pull * u) - cloth.drag * v + scene.force.reshape(n, 3)
        more = stiffness * along(u, dd) + damping * (along(dw, u) + along(w, du))
        more += of_family * (
            (kinds == "stiffness") * (length - rest) + (kinds == "damping") * along(w, u)
        )
        change = -ends.T @ (more * u + pull * du) - cloth.drag * dv
        change -= (kinds == "drag") * v + (kinds == "mass") * total / mass.sum()
        accelerations = np.concatenate([(total / mass + scene.gravity)[None], change / mass + up])
        return (np.stack([y[:, 1], accelerations], axis=1) * free).ravel()

    start = np.zeros((1 + len(names), 2, n, 3))
    start[0, 0] = scene.initial_position.reshape(n, 3)
    for k, name in enumerate(names, 1):
        if name.startswith("pin"):
            start[k, 0, np.flatnonzero(~free)[int(name[3])], "xyz".index(name[-1])] = 1
    result = integrate.solve_ivp(
        slope, (0, times[-1]), start.ravel(), "DOP853", times, rtol=1e-11, atol=1e-13
    )
    return result.y.T.reshape(len(times), 1 + len(names), 2, *cloth.shape, 3)[:, 1:, 0].swapaxes(
        0, 1
    )


def test_it_agrees_with_the_variational_equations():
    parts = [f"{kind}_{family}" for kind in ("stiffness", "damping") for family in STIFFNESS]
    names = [*parts, "drag", "mass", "gravity_y", "pin0_x", "pin1_y"]
    expected = variational(SCENE, TIMES, names)
    result = cs.sensitivity(SCENE, TIMES, names)
    for name, exact in zip(names, expected):
        slopes = result.sel(parameter=name)
        largest = np.abs(exact).max()
        off = np.abs(slopes.dx.values - exact).max(axis=(1, 2, 3))
        assert off.max() < 1e-8 * largest, name
        assert (off <= slopes.error.values).all() and slopes.error.max() < 1e-4 * largest, name
    assert set(result.reason.values) == {""} and (result.known_until == TIMES[-1]).all()
    assert result.unit.values.tolist()[-5:] == ["N s/m", "kg", "m/s^2", "m", "m"]


@pytest.mark.parametrize("damping", [0.0, 1.0])  # at 0 no central difference exists
def test_it_agrees_with_the_formula_of_the_oscillator(damping):
    times = np.linspace(0.5, 5, 10)

    def x(k, c):
        u = np.sqrt(k - c**2 / 4 + 0j)
        return 0.1 * np.exp(-c / 2 * times) * (np.cos(u * times) + c / 2 / u * np.sin(u * times))

    result = cs.sensitivity(cs.scenes.oscillator(damping=damping), times, ["stiffness", "damping"])
    for k, shifts in enumerate([(1e-30j, 0), (0, 1e-30j)]):
        exact = x(100 + shifts[0], damping + shifts[1]).imag / 1e-30
        assert np.abs(result.dx.values[k, :, 0, 1, 0] - exact).max() < 1e-9 * np.abs(exact).max()


def test_names_stand_for_what_they_say():
    masses = np.linspace(1, 2, 12).reshape(3, 4) / 90
    scene = SCENE.replace(cloth=CLOTH.replace(mass=masses, stiffness=50.0))
    result = cs.sensitivity(
        scene,
        TIMES,
        ["mass", "stiffness", "stiffness.shear", "stiffness_structural", "stiffness_bend"],
    )
    np.testing.assert_allclose(result.value, [masses.sum(), 50, 50, 50, 50])
    whole, parts = result.dx.values[1], result.dx.values[2:].sum(axis=0)
    assert np.abs(whole - parts).max() < 1e-7 * np.abs(whole).max()
    up, down = (
        cs.simulate(
            scene.replace(cloth=scene.cloth.replace(mass=masses * f)), TIMES[-1], rtol=1e-10
        )
        for f in (1.001, 0.999)
    )
    by_hand = (up.x[-1] - down.x[-1]) / (0.002 * masses.sum())
    assert np.abs(result.dx.values[0, -1] - by_hand).max() < 1e-4 * np.abs(by_hand).max()


def test_a_contact_ends_what_is_known():
    scene = cs.Scene(
        cs.Cloth((6, 6), mass=18.0, stiffness=3e3, damping=10.0),
        cs.Sphere((0.5, -0.5, 0.5), 0.25, response="reflect", friction=0.2),
    )
    times = np.linspace(0.05, 0.4, 8)
    names = ["stiffness", "sphere_radius", "sphere0_center_y", "sphere_friction"]
    contact = cs.simulate(scene, 0.4, dt=1e-4).report["first_contact"]["time"]
    result = cs.sensitivity(scene, times, [*names, "sphere_restitution"])
    before = times < contact - 1e-3
    assert 0 < before.sum() < len(times)
    assert (
        np.isfinite(result.dx.values[:, before]).all() and (result.dx.values[1:, before] == 0).all()
    )
    assert (
        np.isnan(result.dx.values[:, ~before]).all()
        and np.isnan(result.error.values[:, ~before]).all()
    )
    assert (result.known_until == times[before][-1]).all()
    assert all(
        "a sphere responds after the step that begins at 0.2" in reason
        for reason in result.reason.values
    )


def test_derivatives_go_on_through_a_layer():
    """Compare with central differences of runs at a tight tolerance, in contact with friction."""
    cloth = cs.Cloth((6, 6), (0.8, 0.8), mass=0.4, stiffness=60.0, damping=0.1, drag=0.004)
    ball = cs.Sphere((0.4, -0.3, 0.4), 0.2, friction=0.3, slip_speed=0.1)
    scene = cs.Scene(cloth, ball)
    layer = ball.layer(cloth)
    times = [0.3, 0.6]
    names = ["damping", "sphere_stiffness", "sphere_friction"]
    result = cs.sensitivity(scene, times, names)
    assert not any(result.reason.values) and (result.known_until == 0.6).all()
    assert cs.simulate(scene, 0.6, rtol=1e-4).report["first_contact"]["time"] < 0.25
    for name, value in zip(names, (0.1, layer["stiffness"], 0.3)):
        step = 1e-4 * value
        ends = []
        for sign in (-1, 1):
            changed = (value + sign * step,)
            if name == "damping":  # which moves no layer
                other = scene.replace(cloth=cloth.replace(damping=changed[0]))
            else:
                part = name.removeprefix("sphere_")
                other = scene.replace(spheres=ball.replace(**{part: changed[0]}))
            ends.append(cs.simulate(other, 0.6, rtol=1e-10, times=times).x[1:3])
        expected = (ends[1] - ends[0]) / (2 * step)
        off = abs(result.dx.sel(parameter=name).values - expected).max(axis=(1, 2, 3))
        assert (off < 1e-4 * abs(expected).max()).all()


def test_where_buckling_amplifies_rounding_nothing_is_known():
    cloth = cs.Cloth(
        (6, 6),
        (0.5, 0.5),
        0.1,
        200.0,
        0.0,
        pins=[(row, side) for row in range(6) for side in (0, 5)],
    )
    position = (
        cloth.rest_positions * (0.7, 1, 1)
        + 1e-9 * np.random.default_rng(0).normal(size=(6, 6, 3)) * ~cloth.pinned[..., None]
    )
    result = cs.sensitivity(
        cs.Scene(cloth, position=position), np.linspace(0.1, 2, 6), ["stiffness"]
    )
    assert np.isnan(result.dx.values[0, -1]).all() and np.isfinite(result.dx.values[0, 0]).all()
    assert (
        result.reason.item().startswith("differences of two orders disagree from")
        and result.known_until < 2
    )


def test_a_plane_has_a_friction_alone():
    scene = SCENE.replace(spheres=[cs.Plane((0, -3, 0), friction=0.2), cs.Sphere((9, 9, 9))])
    assert (cs.sensitivity(scene, [0.1], ["sphere0_friction", "sphere1_radius"]).dx == 0).all()
    for name in ("sphere0_radius", "sphere_restitution"):
        with pytest.raises(ValueError, match=f"of must name numbers of the scene, got '{name}'"):
            cs.sensitivity(scene, [0.1], [name])


def test_an_unstable_run_ends_what_is_known(monkeypatch):
    monkeypatch.setattr("clothsim.accuracy.sensitivity._LONGEST", 4.0)
    with pytest.warns(cs.StabilityWarning):
        result = cs.sensitivity(
            SCENE.replace(cloth=CLOTH.replace(stiffness=1e5)), [0.2, 2.0], ["stiffness"]
        )
    assert np.isnan(result.dx.values[0, -1]).all() and result.reason.item()


def test_steps_end_where_a_pin_turns():
    turn = cs.Keyframes([0.0, 0.1234, 1.0], offsets=[(0, 0, 0), (0, 0.1, 0), (0, 0, 0)])
    scene = cs.Scene(
        cs.Cloth((3, 3), mass=0.1, stiffness=50.0, damping=0.01, pins={(0, 0): turn, (2, 0): None})
    )
    schedule = Schedule(scene, check_times([0.3]), 1e-9)
    assert schedule.stops == [0.1234, 0.3]
    x = schedule.compute_positions([scene], schedule.step_counts(scene)).x[0, 0]
    assert np.abs(x - cs.reference(scene, 0.3).x[-1]).max() < 1e-9


def test_the_cost_in_runs(monkeypatch):
    counts = []
    run = Schedule.compute_positions

    def count_steps(schedule, scenes, steps):
        counts.append(len(scenes) * steps.sum())
        return run(schedule, scenes, steps)

    monkeypatch.setattr(Schedule, "compute_positions", count_steps)
    cs.sensitivity(SCENE, TIMES, ["stiffness_shear", "drag", "mass"])
    single = Schedule(SCENE, TIMES, 1e-11).step_counts(SCENE).sum()
    assert 0 < sum(counts) <= (3 * 3 + 2.8) * single * 1.05
