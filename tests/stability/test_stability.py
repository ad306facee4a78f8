"""Time steps: the guarantee, the limit predicted from the spectrum, and the limit measured."""

import math

import clothsim as cs
import numpy as np
import pytest
from clothsim.methods.region import mode_limit
from clothsim.stability.limit import tangent
from clothsim.stability.map import is_stable
from variants import pairs

EXPLICIT = tuple(name for name, one in cs.integrators().items() if one.explicit)
BOUNDED = tuple(name for name in EXPLICIT if cs.integrators()[name].imaginary_limit > 0)
SHAPES = [(8, 8), (5, 13), (2, 9), (1, 12)]
DAMPINGS = {"none": (0.0, 0.0), "springs": (0.3, 0.0), "much": (3.0, 0.0), "points": (0.0, 0.5), "both": (0.3, 0.5)}


def sheet(shape, stiffness, damping, drag=0.0, **changes):
    """Half a kilogram a point; `damping` and `drag` in parts of sqrt(K m)."""
    cloth = cs.Cloth(
        shape,
        mass=0.5 * shape[0] * shape[1],
        stiffness=stiffness,
        damping=damping * math.sqrt(stiffness * 0.5),
        drag=drag * math.sqrt(stiffness * 0.5),
        **changes,
    )
    return cs.Scene(cloth, gravity=(0, 0, 0))


def measured_limit(scene, x, v, near, integrator="rk4"):
    """By bisection on runs of 400 steps, to 1 % above."""
    low, high = 0.85 * near, 1.3 * near
    assert is_stable(scene, x, v, low, 400, integrator=integrator)
    assert not is_stable(scene, x, v, high, 400, integrator=integrator)
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        if is_stable(scene, x, v, middle, 400, integrator=integrator):
            low = middle
        else:
            high = middle
    return low


@pairs(shape=SHAPES, damping=DAMPINGS, stiffness=[1e2, 1e4, 1e7])
def test_with_a_state_it_is_at_most_a_tenth_below_the_measured_limit(shape, damping, stiffness):
    scene = sheet(shape, stiffness, *DAMPINGS[damping])
    x, v = scene.initial_position, scene.initial_velocity
    predicted = cs.max_stable_dt(scene, x=x)
    assert predicted <= measured_limit(scene, x, v, predicted) <= predicted / 0.9
    assert cs.max_stable_dt(scene) <= predicted


def test_nothing_limits_an_implicit_method():
    scene = sheet((4, 4), 1e4, 0.3)
    assert cs.max_stable_dt(scene, "implicit_midpoint") == math.inf
    assert cs.max_stable_dt(scene, "implicit_midpoint", scene.initial_position) == math.inf


def moving(crumpled, **features):
    state = crumpled(shape=(5, 6), **features)
    return state.scene, state.x, state.v


@pytest.mark.parametrize("model", ["springs", "points", "both"])
def test_the_tangent_is_the_derivative_of_the_acceleration(crumpled, model):
    scene, x, v = moving(crumpled, damped_by=model)
    stiffness, damping = tangent(scene, x, v)
    root = np.sqrt(scene.cloth.mass_per_point)[..., None]
    y = np.random.default_rng(4).normal(size=x.shape) * ~scene.cloth.pinned[..., None]
    h = 1e-6
    for product, dx, dv in ((stiffness, h, 0), (damping, 0, h)):
        ahead = cs.acceleration(scene, x + dx * y, v + dv * y)
        behind = cs.acceleration(scene, x - dx * y, v - dv * y)
        expected = (behind - ahead) / (2 * h)
        result = product((root * y).reshape(1, -1)).reshape(x.shape) / root
        assert np.abs(result - expected).max() < 1e-6 * np.abs(expected).max()


def test_velocities_count_where_springs_are_damped(crumpled):
    scene, x, v = moving(crumpled)
    still = cs.max_stable_dt(scene, x=x)
    assert cs.max_stable_dt(scene, x=x, v=0 * v) == still
    assert abs(cs.max_stable_dt(scene, x=x, v=30 * v) / still - 1) > 1e-3


def test_a_light_pinned_point_does_not_count():
    mass = np.full((6, 6), 0.5)
    even = cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass, pins=[(0, 0)])))
    mass[0, 0] = 1e-6
    assert cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass, pins=[(0, 0)]))) >= even
    assert cs.max_stable_dt(cs.Scene(cs.Cloth((6, 6), mass=mass))) == pytest.approx(even, rel=0.2, abs=0)
    free = cs.Scene(cs.Cloth((6, 6), mass=mass, pins=()))
    assert cs.max_stable_dt(free) < 1e-5 * even
    held = cs.Cloth((2, 2), pins=[(0, 0), (0, 1), (1, 0), (1, 1)])
    assert cs.max_stable_dt(cs.Scene(held)) == math.inf
    assert cs.max_stable_dt(cs.Scene(held), x=held.rest_positions) == math.inf


def test_a_light_point_among_heavy_ones_is_bounded_by_its_own_springs():
    """4 structural springs: lambda <= sum K (1/m + 1/M), where the lightest mass alone gives 8 K / m."""
    mass = np.full((7, 7), 100.0)
    mass[3, 3] = 1e-3
    cloth = cs.Cloth((7, 7), mass=mass, stiffness=50.0, damping=0.0, springs=("structural",))
    expected = math.sqrt(8 / (4 * 50.0 * (1 / 1e-3 + 1 / 100.0)))
    assert cs.max_stable_dt(cs.Scene(cloth)) == pytest.approx(expected, rel=1e-6, abs=0)


@pytest.mark.parametrize("integrator", EXPLICIT)
def test_the_limits_on_the_axes_are_those_of_the_table(integrator):
    method = cs.integrators()[integrator]
    found = mode_limit(integrator, [4.0, 0.0], [0.0, 5.0])
    np.testing.assert_allclose(found, [method.imaginary_limit / 4, method.real_limit / 5], rtol=2e-4)
