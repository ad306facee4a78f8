"""`max_stable_dt` at a state against dense step matrices that are assembled here, spring by spring."""

import math

import clothsim as cs
import numpy as np
import pytest
import stable_step as bench


def ratio(scene, method, x, v):
    value = cs.max_stable_dt(scene, method, x, v)
    return value / bench.Truth(*bench.dense(scene, x, v)).limit(method, value)


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning")
def test_a_run_at_the_value_does_not_diverge():
    """6 x 14 points; taken mode by mode, the limit of Verlet's method comes out 1.1 times too large."""
    stiffness = {"structural": 1e4, "shear": 6e5, "bend": 3e3}
    cloth = cs.Cloth((6, 14), mass=84 * 0.5, stiffness=stiffness, damping=32.0)
    noise = 1e-7 * np.random.default_rng(1).normal(size=(6, 14, 3))
    scene = cs.Scene(cloth, gravity=(0, 0, 0), position=cloth.rest_positions + noise)
    for method in ("semi_implicit_euler", "velocity_verlet", "pefrl"):
        dt = cs.max_stable_dt(scene, method, cloth.rest_positions)
        state = cs.Stepper(scene, integrator=method)
        state._state.judge.given.add("dt")
        state.advance(2000, dt)
        assert np.abs(state.positions - cloth.rest_positions).max() < 1e-6


@pytest.mark.parametrize("number", range(5))
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
                assert cs.max_stable_dt(scene, method) <= limit, (what, method)


@pytest.mark.parametrize("method", bench.METHODS)
def test_nothing_limits_where_no_spring_pulls_on_a_free_point(method):
    for features in ({"springs": ()}, {"stiffness": 0.0, "damping": 0.0}, {"pins": np.ones((3, 4), bool)}):
        cloth = cs.Cloth((3, 4), **features)
        assert cs.max_stable_dt(cs.Scene(cloth), method, cloth.rest_positions) == math.inf


@pytest.mark.parametrize("method", bench.METHODS)
def test_buckling_does_not_count(method):
    """A compressed sheet is unstable in the exact motion; the limit is that of its other modes."""
    cloth = cs.Cloth((3, 4), mass=6.0, stiffness=1e4, damping=0.3)
    scene, x = cs.Scene(cloth), 0.8 * cloth.rest_positions
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
