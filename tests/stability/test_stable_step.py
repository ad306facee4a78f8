"""`max_stable_dt`, at a state against dense step matrices of the benchmark, spring by spring."""

import math
import warnings

import clothsim as cs
import numpy as np
import pytest
import stable_step as bench


def ratio(scene, method, x, v):
    value = cs.max_stable_dt(scene, method, x, v)
    return value / bench.Truth(*bench.dense(scene, x, v)).limit(method, value)


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning")
def test_a_run_at_the_value_does_not_diverge():
    """6 x 14 points; taken mode by mode, Verlet's limit comes out 1.1 times too large."""
    stiffness = {"structural": 1e4, "shear": 6e5, "bend": 3e3}
    cloth = cs.Cloth((6, 14), mass=84 * 0.5, stiffness=stiffness, damping=32.0)
    noise = 1e-7 * np.random.default_rng(1).normal(size=(6, 14, 3))
    scene = cs.Scene(cloth, gravity=(0, 0, 0), position=cloth.rest_positions + noise)
    for method in ("semi_implicit_euler", "velocity_verlet", "pefrl"):
        dt = cs.max_stable_dt(scene, method, cloth.rest_positions)
        state = cs.Stepper(scene, integrator=method)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cs.StabilityWarning)
            state.advance(2000, dt)
        assert np.abs(state.positions - cloth.rest_positions).max() < 1e-6


@pytest.mark.parametrize("number", range(8))
def test_of_random_scenes(number):
    rng = np.random.default_rng([7, number])
    scene, x, v, what = bench.random_case(rng)
    while scene.cloth.rows * scene.cloth.columns > 15:
        scene, x, v, what = bench.random_case(rng)
    truth = bench.Truth(*bench.dense(scene, x, v))
    for method in bench.METHODS:
        value = cs.max_stable_dt(scene, method, x, v)
        if math.isfinite(value):
            limit = truth.limit(method, value)
            assert 0.9 <= value / limit <= 1.0, (what, method)
            if what.endswith(("rest", "stretch")):
                assert truth.stable(method, cs.max_stable_dt(scene, method)), (what, method)


@pytest.mark.parametrize("method", bench.METHODS)
def test_nothing_limits_where_no_spring_pulls_on_a_free_point(method):
    for features in (
        {"springs": ()},
        {"stiffness": 0.0, "damping": 0.0},
        {"pins": np.ones((3, 4), bool)},
    ):
        cloth = cs.Cloth((3, 4), **features)
        assert cs.max_stable_dt(cs.Scene(cloth), method, cloth.rest_positions) == math.inf


@pytest.mark.parametrize("method", bench.METHODS)
def test_buckling_does_not_count(method):
    """A compressed sheet is unstable in the exact motion; the limit is that of its other modes."""
    cloth = cs.Cloth((3, 4), mass=6.0, stiffness=1e4, damping=0.3)
    scene = cs.Scene(cloth)
    x = 0.8 * cloth.rest_positions
    assert bench.Truth(*bench.dense(scene, x, 0 * x)).rates.real.max() > 1
    assert 0.9 <= ratio(scene, method, x, 0 * x) <= 1.0


def test_a_folded_state_has_a_limit_or_an_error_that_names_the_points():
    cloth = cs.Cloth((4, 4), mass=8.0)
    folded = cloth.rest_positions.copy()
    folded[:, 2:] = folded[:, 1::-1]
    for method in bench.METHODS:
        assert 1e-4 < cs.max_stable_dt(cs.Scene(cloth), method, folded) < math.inf
    near = cloth.rest_positions.copy()
    near[0, 1] = near[0, 0] + [1e-150, 0, 0]
    with pytest.raises(ValueError, match=r"x must .* \(0, 0\) and \(0, 1\)"):
        cs.max_stable_dt(cs.Scene(cloth), "rk4", near)


def test_nothing_limits_an_implicit_method():
    scene = cs.Scene(cs.Cloth((4, 4)))
    assert cs.max_stable_dt(scene, "implicit_midpoint") == math.inf
    assert cs.max_stable_dt(scene, "implicit_midpoint", scene.initial_position) == math.inf


def test_velocities_count_where_springs_are_damped(crumpled):
    scene, x, v, _ = crumpled(shape=(5, 6))
    still = cs.max_stable_dt(scene, x=x)
    assert cs.max_stable_dt(scene, x=x, v=0 * v) == still
    assert abs(cs.max_stable_dt(scene, x=x, v=30 * v) / still - 1) > 1e-3


def test_a_light_pinned_point_does_not_count():
    mass = np.full((6, 6), 0.5)
    even = cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass, pins=[(0, 0)])))
    mass[0, 0] = 1e-6
    assert cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass, pins=[(0, 0)]))) >= even
    assert cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass))) == pytest.approx(
        even, rel=0.2, abs=0
    )
    free = cs.Scene(cs.Cloth((6, 6), mass=mass, pins=()))
    assert cs.max_stable_dt(free) < 1e-5 * even


def test_a_light_point_among_heavy_ones_is_bounded_by_its_own_springs():
    """4 structural springs: lambda <= sum K (1/m + 1/M); the lightest mass alone gives 8 K / m."""
    mass = np.full((7, 7), 100.0)
    mass[3, 3] = 1e-3
    cloth = cs.Cloth((7, 7), mass=mass, stiffness=50.0, damping=0.0, springs=("structural",))
    expected = math.sqrt(8 / (4 * 50.0 * (1 / 1e-3 + 1 / 100.0)))
    assert cs.max_stable_dt(cs.Scene(cloth)) == pytest.approx(expected, rel=1e-6, abs=0)
