"""Every kernel on every instruction set against the scalar reference, and that against NumPy.

The bounds on a relative difference are a few times what was seen (1e-13 and 2e-5). A term left
out or a wrong coefficient is at 1e-4 or more.
"""

import functools
import itertools
import math

import clothsim as cs
import numpy as np
from clothsim.model.cloth import FAMILIES
from tables import each
from variants import cases

SHAPES = [(2, 2), (2, 1), (1, 2), (1, 9), (23, 1), (3, 50), (17, 33), (40, 7), (16, 16), (32, 32)]
SUBSETS = [s for n in range(len(FAMILIES) + 1) for s in itertools.combinations(FAMILIES, n)]
DAMPING = ["nothing", "springs", "points", "both"]
MASS = ["uniform", "per point"]
MASKS = {
    "none": np.zeros((7, 21), bool),
    "all": np.ones((7, 21), bool),
    "first column": np.arange(21) == np.zeros((7, 1)),
    "random": np.random.default_rng(3).random((7, 21)) < 0.3,
}
STEPS = 100


# In single each stage's force is rounded to float32, whatever is done for the state.
BOUND = {"double": 1e-12, "single": 5e-5}


@functools.cache
def _reference(crumpled, steps=STEPS, pins=None, **features):
    state = crumpled(**features, pins=MASKS.get(pins))
    scene, x, v, dt = state
    return state, cs.reference_step(scene, x, v, dt, steps)


@cases()
@each("shape", SHAPES)
def test_every_shape_agrees_with_the_reference(variant, crumpled, relative, shape):
    (scene, x, v, dt), expected = _reference(crumpled, shape=shape)
    result = cs.step(scene, x, v, dt, STEPS, **variant.options)
    assert relative(result, expected, x) < BOUND[variant.precision]


@cases()
@each("damping", ["nothing", "springs"])
def test_a_cloth_that_does_not_fit_in_cache_agrees_with_the_reference(
    variant, crumpled, relative, damping
):
    """There the edge kernel's four stages follow each other a few rows apart: also half of it, and
    of 2 MiB.
    """
    (scene, x, v, dt), expected = _reference(crumpled, 6, shape=(340, 100), damped_by=damping)
    for threads in (1, 2):
        result = cs.step(scene, x, v, dt, 6, **{**variant.options, "threads": threads})
        assert relative(result, expected, x) < BOUND[variant.precision]


@cases(springs=SUBSETS)
@each("damping", DAMPING)
def test_every_feature_agrees_with_the_reference(variant, crumpled, relative, springs, damping):
    # A sheet without bend springs magnifies rounding: in single to 1.5e-5 in 40 steps, to 6e-5 in
    # 100.
    steps = 40
    # Rows that end within a vector, and the paper's, whose kernel is compiled apart.
    for shape, mass in itertools.product([(6, 19), (9, 32)], MASS):
        features = {"shape": shape, "springs": springs, "mass": mass, "damped_by": damping}
        (scene, x, v, dt), expected = _reference(crumpled, steps, **features)
        result = cs.step(scene, x, v, dt, steps, **variant.options)
        assert relative(result, expected, x) < BOUND[variant.precision], (shape, mass)


# The shapes: rows that end within a vector, of as many vectors as the paper's (31) and of more or
# fewer.
@cases()
@each("shape", [(6, 19), (9, 32), (7, 31), (6, 33), (5, 50), (6, 64), (5, 9), (40, 7)])
def test_equal_damping_of_all_families(variant, crumpled, relative, shape):
    """It is taken out of the springs' coefficients; a damping so small that single could not hold
    them stays in.
    """
    for mass, damping in itertools.product(MASS, (0.4, 1e-30)):
        (scene, x, v, dt), expected = _shared_damping(crumpled, shape, mass, damping)
        result = cs.step(scene, x, v, dt, 40, **variant.options)
        assert relative(result, expected, x) < BOUND[variant.precision], (mass, damping)


@functools.cache
def _shared_damping(crumpled, shape, mass, damping):
    scene, x, v, dt = crumpled(shape=shape, mass=mass)
    scene = scene.replace(cloth=scene.cloth.replace(damping=damping))
    return (scene, x, v, dt), cs.reference_step(scene, x, v, dt, 40)


@cases()
@each("springs, damping, mass", itertools.product(SUBSETS, DAMPING, MASS))
def test_accelerations_are_those_of_newton(variant, crumpled, oracle, springs, damping, mass):
    scene, x, v, _ = crumpled(shape=(5, 18), springs=springs, mass=mass, damped_by=damping)
    expected = oracle.acceleration(scene, x, v)
    result = cs.acceleration(scene, x, v, **variant.options)
    bound = {"double": 1e-13, "single": 2e-5}[variant.precision]
    assert np.abs(result - expected).max() < bound * np.abs(expected).max()


@cases()
@each("pins", MASKS)
def test_pins(variant, crumpled, relative, pins):
    mask = MASKS[pins]
    (scene, x, v, dt), expected = _reference(crumpled, shape=mask.shape, pins=pins)
    result = cs.step(scene, x, v, dt, STEPS, **variant.options)
    # In single a state is two float32: 48 bits of what was given.
    motion = np.abs(result[0] - x)[mask].max(initial=0)
    assert motion <= {"double": 0.0, "single": 1.5 * 2.0**-48}[variant.precision]
    assert (result[1][mask] == 0).all()
    if pins != "all":
        assert relative(result, expected, x) < BOUND[variant.precision]


def test_auto_is_the_edge_kernel(crumpled, same_bits, precision):
    scene, x, v, dt = crumpled()
    auto, edge, gather = (
        cs.step(scene, x, v, dt, 50, precision=precision, kernel=k)
        for k in ("auto", "edge", "gather")
    )
    assert same_bits(auto, edge) and not same_bits(auto, gather)


@cases()
def test_coincident_points_give_no_force(variant, crumpled):
    """A spring of length 0 has no direction; its two ends must not become NaN."""
    scene, x, v, _ = crumpled(springs=("structural",), damped_by="nothing")
    v[:] = 0
    x[3, 5] = x[3, 6]
    a = cs.acceleration(scene, x, v, **variant.options)
    assert np.isfinite(a).all()
    x[...] = 1.0
    a = cs.acceleration(scene, x, v, **variant.options)
    free = ~scene.cloth.pinned
    np.testing.assert_allclose(a[free], np.broadcast_to(scene.gravity, a[free].shape), rtol=1e-6)


def test_the_reference_is_newton_integrated(crumpled, oracle):
    """One step of classic RK4 written out on the NumPy oracle: no line is shared with the core."""
    scene, x, v, dt = crumpled()
    k = [(v, oracle.acceleration(scene, x, v))]
    for part in (0.5, 0.5, 1.0):
        dx, dv = k[-1]
        y, w = x + part * dt * dx, v + part * dt * dv
        k.append((w, oracle.acceleration(scene, y, w)))
    weights = np.array([1, 2, 2, 1]) / 6
    expected = [
        start + dt * sum(w * slope[i] for w, slope in zip(weights, k))
        for i, start in enumerate((x, v))
    ]
    for result, part in zip(cs.reference_step(scene, x, v, dt), expected):
        np.testing.assert_allclose(result, part, rtol=0, atol=1e-14 * np.abs(part).max())


def test_the_papers_printed_form_is_rk4_with_the_squared_step(crumpled, relative):
    scene, x, v, dt = crumpled()
    printed = cs.reference_step(scene, x, v, math.sqrt(dt), 20, as_printed=True)
    assert relative(printed, cs.reference_step(scene, x, v, dt, 20), x) < 1e-12


@cases()
@each("shape", [(17, 17), (9, 33), (2, 1), (1, 5)])
def test_a_sheet_at_rest_stays_at_rest(variant, shape):
    """Exactly in double and in the gather kernel: rest lengths are rounded like lengths of springs.

    The edge kernel in single: the length is l^2 times a rounded 1/l, which differs from the rest
    length by one unit in the last place (by up to three with AVX2's estimate).
    """
    rows, columns = shape
    cloth = cs.Cloth(shape, size=((rows - 1) / 16 or 1, (columns - 1) / 16 or 1), pins=())
    x = cloth.rest_positions
    v = np.zeros((*shape, 3))
    after = cs.step(cs.Scene(cloth, gravity=(0, 0, 0)), x, v, 5e-4, 1000, **variant.options)
    if variant.kernel == "gather" or variant.precision == "double":
        np.testing.assert_array_equal(after[0], x)
        np.testing.assert_array_equal(after[1], v)
        return
    assert np.abs(after[0] - x).max() < 3 * 2.0**-24
    assert np.abs(after[1]).max() < 300 * 2.0**-24
