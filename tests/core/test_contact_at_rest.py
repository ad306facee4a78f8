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


def heights(precision):
    """Over the sphere: the least, and the top of the band on which points are put; and how far above that points rest."""
    epsilon = float(EPSILON[precision])
    slop = 2 * epsilon * (np.abs(CENTER + (0, RADIUS, 0)).sum() + RADIUS)
    levels = slop * (2 + slop / RADIUS) + RADIUS * epsilon * np.array((0, 8, 24))  # h (2 + h / R) of heights
    least, top, rests = levels / (1 + np.sqrt(1 + levels / RADIUS))
    return least, top, rests - top


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


@pytest.mark.parametrize("upper", [False, True])
def test_the_boundary_of_rest(upper):
    """Who lies in the band stays; above it falls on, below it is lifted to its top.

    The lower rim is looked at closer than a float32 can see: to 1e-11 of the radius. The upper one is as float32 sees it.
    """
    rng = np.random.default_rng(7)
    n, (least, top, tolerance) = directions(rng), heights("single")
    aside = rng.choice((-1, 1), SHAPE) * (1 if upper else 1e-3) * tolerance * rng.uniform(0.6 if upper else 0.1, 0.9, SHAPE)
    x = stored(CENTER + (RADIUS + (top + tolerance if upper else least) + aside)[..., None] * n, "single")
    v = -0.02 * tolerance / DT * n
    (free, v_free), (after, v_after) = stepped(x, v, "single", restitution=0.0)

    start, end = length(from_centre(x)), length(from_centre(after))
    high, low = start > RADIUS + top + tolerance, start < RADIUS + least
    rests = ~(high | low)
    assert min(rests.sum(), (high | low).sum()) > 500
    np.testing.assert_array_equal(after[high], free[high])
    np.testing.assert_array_equal(v_after[high], v_free[high])
    assert np.abs(end - start)[rests].max() < 1e-14
    assert np.abs(end - RADIUS - top)[low].max(initial=0) < 1e-14
    assert np.abs(v_after[~high]).max() < 1e-6 * np.abs(v).max()


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_whether_a_point_at_rest_is_pressed_is_decided_in_double(precision, friction):
    """Along the sphere to 1e-7 of the way: up or down is a matter of digits float32 has not."""
    rng = np.random.default_rng(8)
    n = directions(rng)
    x = stored(CENTER + (RADIUS + heights(precision)[1]) * n, precision)
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
