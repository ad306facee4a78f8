"""Points that lie on a sphere when the step begins: what is decided there, to the last digit.

The state of precision "single" is a float32 and the rest of it; the time of impact hangs on both.
"""

import clothsim as cs
import numpy as np
import pytest
from points import CENTER, RADIUS, drifting

DT = 2.0**-10
SHAPE = (40, 50)
EPSILON = {"double": np.finfo(np.float64).eps, "single": np.finfo(np.float32).eps}


def slop(precision):
    """How far outside the sphere points are put: 4 ulp of |centre| + radius."""
    return 4 * float(EPSILON[precision]) * (np.abs(CENTER).sum() + RADIUS)


def directions(rng):
    n = rng.normal(size=(*SHAPE, 3))
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


def stored(x, precision):
    """The nearest state of the precision: in single the nearest float32 and that of the rest."""
    if precision == "double":
        return x
    nearest = x.astype(np.float32)
    return nearest + (x - nearest).astype(np.float32).astype(float)


def stepped(x, v, precision, **arguments):
    """A step without forces past a still sphere: without it, and with it."""
    sphere = cs.Sphere(CENTER, RADIUS, None, "continuous", "none", **{"restitution": 1.0, **arguments})
    scene = drifting(x, sphere)
    return (cs.step(scene.replace(spheres=()), x, v, DT, precision=precision), cs.step(scene, x, v, DT, precision=precision))


def from_centre(x):
    return x.astype(np.longdouble) - CENTER


def length(p):
    return np.sqrt((p**2).sum(axis=-1))


@pytest.mark.parametrize("edge", [-1, 1])
def test_the_boundary_of_rest_is_decided_in_double(edge):
    """Who lies within a quarter of the slop stays; above it falls on, below it is lifted.

    The rim is looked at closer than a float32 can see: to 1e-11 of the radius.
    """
    rng = np.random.default_rng(7)
    n, quarter = directions(rng), slop("single") / 4
    surface = RADIUS + slop("single")
    aside = rng.choice((-1, 1), SHAPE) * 1e-4 * quarter * 10 ** rng.uniform(-1, 0, SHAPE)
    x = stored(CENTER + (surface + edge * quarter + aside)[..., None] * n, "single")
    v = -0.02 * quarter / DT * n
    (free, v_free), (after, v_after) = stepped(x, v, "single", restitution=0.0)

    start, end = length(from_centre(x)), length(from_centre(after))
    high, low = start > surface + quarter, start < surface - quarter
    rests = ~(high | low)
    assert min(rests.sum(), (high | low).sum()) > 500
    np.testing.assert_array_equal(after[high], free[high])
    np.testing.assert_array_equal(v_after[high], v_free[high])
    assert np.abs(end - start)[rests].max() < 1e-14
    assert np.abs(end - surface)[low].max(initial=0) < 1e-14
    assert np.abs(v_after[~high]).max() < 1e-6 * np.abs(v).max()


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_whether_a_point_at_rest_is_pressed_is_decided_in_double(precision, friction):
    """Along the sphere to 1e-7 of the way: up or down is a matter of digits float32 has not."""
    rng = np.random.default_rng(8)
    n = directions(rng)
    x = stored(CENTER + (RADIUS + slop(precision)) * n, precision)
    aside = np.cross(n, directions(rng))
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    v = 0.01 * RADIUS / DT * (aside + 1e-7 * rng.normal(size=(*SHAPE, 1)) * n)
    (free, _), (after, _) = stepped(x, v, precision, restitution=0.0, friction=friction)

    p, way = from_centre(x), from_centre(free) - from_centre(x)
    inwards = (p * way).sum(axis=-1) / (length(p) * length(way))
    told = np.abs(inwards) > 1e-9
    assert min((inwards < -1e-9).sum(), (inwards > 1e-9).sum()) > 500
    changed = (after != free).any(axis=-1)
    np.testing.assert_array_equal(changed[told], inwards[told] < 0)
