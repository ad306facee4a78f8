"""When a moving triangle touches a sphere, against bisection in Python."""

import numpy as np
from clothsim import _core
from contact_fuzz.exact import distance


def nearest(corners):
    """Weights of the place of a triangle that is nearest to the origin."""
    best, least = None, np.inf
    for free in ((0, 1, 2), (0, 1), (1, 2), (2, 0), (0,), (1,), (2,)):
        c = corners[list(free)]
        sides = (c[1:] - c[0]).T
        along = np.linalg.lstsq(sides, -c[0], rcond=None)[0] if len(free) > 1 else np.zeros(0)
        weights = np.concatenate([[1 - along.sum()], along])
        far = np.linalg.norm(weights @ c)
        if (weights >= 0).all() and far < least:
            best, least = np.zeros(3), far
            best[list(free)] = weights
    return best


def meeting(p0, p1, radius):
    """The first time at which a moving triangle is as near to the origin as `radius`, or None."""

    def near(t):
        return distance(p0 + np.asarray(t)[..., None, None] * (p1 - p0)) - radius

    t = np.linspace(0, 1, 501)
    inside = near(t) <= 0
    if not inside.any():
        return None
    late = t[inside.argmax()]
    early = max(late - t[1], 0.0)
    for _ in range(40):
        middle = (early + late) / 2
        early, late = (early, middle) if near(middle) <= 0 else (middle, late)
    return late


def test_the_time_of_a_touch_is_the_first():
    """At it the triangle is as near as asked for, before it is not, whoever comes first."""
    rng = np.random.default_rng(12)
    p0 = rng.normal(size=(200, 3, 3)) * rng.choice((0.3, 2.0), (200, 1, 1)) + (0, 0, 2.0)
    p1 = rng.normal(size=(200, 3, 3)) * rng.choice((0.3, 2.0), (200, 1, 1)) - (0, 0, 1.0)
    outside = distance(p0) > 1.01
    p0, p1 = p0[outside], p1[outside]
    times = _core.triangle_touches(p0, p1, 1.0, 1e-9)
    corner = side = face = 0
    for start, end, t in zip(p0, p1, times, strict=True):
        expected = meeting(start, end, 1.0)
        if expected is None:
            s = np.linspace(0, 1, 2001)[:, None, None]
            assert np.isnan(t) or distance(start + s * (end - start)).min() < 1 + 1e-4
            continue
        np.testing.assert_allclose(t, expected, rtol=0, atol=1e-6)
        parts = (nearest(start + t * (end - start)) > 0).sum()
        corner, side, face = corner + (parts == 1), side + (parts == 2), face + (parts == 3)
    assert min(corner, side, face) > 8


def test_the_time_of_a_touch_where_a_triangle_turns_on_the_sphere():
    """It starts at a gap of 2.5e-7 radii and turns by up to 0.3 rad: no advance may stop short."""
    rng = np.random.default_rng(13)
    missed = 0
    for _ in range(60):
        weight, size = rng.dirichlet((1, 1, 1)), 10 ** rng.uniform(-0.5, 1)
        flat = rng.normal(size=(3, 3)) * size
        flat -= weight @ flat
        normal = np.cross(flat[1] - flat[0], flat[2] - flat[0])
        normal /= np.linalg.norm(normal)
        axis = np.cross(normal, rng.normal(size=3))
        axis /= np.linalg.norm(axis)
        start = flat + (1 + 2.5e-7) * normal
        turned = start + rng.uniform(0.02, 0.3) * np.cross(axis, flat) - 1e-5 * rng.uniform() * normal
        t = _core.triangle_touches(start[None], turned[None], 1.0, 3e-8)[0]
        expected = meeting(start, turned, 1.0)
        if expected is None:
            missed += 1
            continue
        assert t == t and distance(start + t * (turned - start)) < 1 + 4e-8
        assert t <= expected + 1e-6
    assert missed < 40
