"""Continuous contact against the reference, which finds impacts by bisection in 64 substeps of each
step.

The reference shares no rule with the contact pass, so the two differ by what the length of a step
explains. With the acceleration a, a path bends by a dt^2 within a step, and a speed changes by a
dt.
"""

import clothsim as cs
import numpy as np
import pytest
from points import CENTER, RADIUS, drifting
from tables import each
from variants import NAMED_KERNELS

# The sphere of the cloth stands on some of its points at first.
pytestmark = pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")

MOTION = cs.Linear((0.4, -0.8, 0.3))
SLIDES = [(1.0, 0.0), (0.6, 0.0), (0.5, 0.2), (0.0, 0.3), (0.0, 9.0)]  # restitution, friction


def ball(center=CENTER, radius=RADIUS, **arguments):
    return cs.Sphere(center, radius, **{"response": "continuous", "offset": "none", **arguments})


def around(rng, distance, shape=(12, 20)):
    """Points at `distance` from the surface, and the normals there."""
    n = rng.normal(size=(*shape, 3))
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return CENTER + (RADIUS + distance) * n, n


@each("restitution, friction", SLIDES)
def test_without_forces_a_step_is_exact(restitution, friction):
    """Paths are straight, so that bisection and formula differ by rounding alone."""
    rng = np.random.default_rng(7)
    x, n = around(rng, rng.uniform(0.01, 0.5, (12, 20, 1)))
    v = rng.normal(size=x.shape) - 1.5 * n
    for motion in (None, MOTION):
        spheres = [ball(restitution=restitution, friction=friction, motion=motion)]
        spheres.append(ball(CENTER + (0, 2.0, 0), 0.4, restitution=0.8))
        scene = drifting(x, spheres)
        expected = cs.reference_step(scene, x, v, 0.3, t=0.0)
        assert 60 < (np.abs(expected[1] - v).max(axis=-1) > 1e-3).sum() < 230
        for kernel in NAMED_KERNELS:
            for mine, theirs in zip(
                cs.step(scene, x, v, 0.3, t=0.0, kernel=kernel), expected, strict=True
            ):
                np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11)


@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
def test_a_cloth_differs_by_what_the_length_of_a_step_explains(crumpled, restitution):
    sphere = cs.Sphere(
        (0.6, -0.2, 0.4),
        0.25,
        cs.Linear((0, 1.5, 0.3)),
        "continuous",
        "edge",
        restitution=restitution,
        friction=0.1,
    )
    scene, x, v, _ = crumpled(spheres=sphere)
    state, dt, met = (x, v), 2e-4, 0
    for k in range(30):
        a = np.abs(cs.acceleration(scene, *state)).max()
        free = cs.step(scene.replace(spheres=()), *state, dt)
        expected = cs.reference_step(scene, *state, dt, t=k * dt)
        for kernel in NAMED_KERNELS:
            result = cs.step(scene, *state, dt, t=k * dt, kernel=kernel)
            place, speed = (
                np.abs(mine - theirs).max() for mine, theirs in zip(result, expected, strict=True)
            )
            assert place < 0.1 * a * dt**2 and speed < 0.25 * a * dt
        met += int((np.abs(expected[1] - free[1]).max(axis=-1) > 1e-9).sum())
        state = expected
    assert met > 50


def test_the_reference_keeps_a_sliding_point_in_coulombs_cone():
    """The reference itself, against formulae: a block on a slope of tan(0.35), and bounces of e^2
    the height.
    """
    slope = np.array((np.sin(0.35), np.cos(0.35), 0.0))
    x = np.tile(1e3 * slope, (2, 2, 1))
    along = np.array((slope[1], -slope[0], 0.0))
    for friction in (0.2, 0.5):
        sphere = cs.Sphere((0, 0, 0), 1e3, None, "continuous", "none", friction=friction)
        _, v = cs.reference_step(drifting(x, sphere, gravity=(0, -9.8, 0)), x, 0 * x, 0.01, 5)
        expected = 9.8 * max(np.sin(0.35) - friction * np.cos(0.35), 0) * 0.05 * along
        np.testing.assert_allclose(v, np.broadcast_to(expected, v.shape), rtol=0, atol=1e-4)
    falling = np.tile((0.0, RADIUS + 0.1, 0.0), (2, 2, 1))
    scene = drifting(
        falling,
        cs.Sphere((0, 0, 0), RADIUS, None, "continuous", "none", restitution=0.7),
        gravity=(0, -9.8, 0),
    )
    x, v = cs.reference_step(scene, falling, 0 * falling, 0.2, 1)
    height = x[..., 1] - RADIUS + v[..., 1] ** 2 / (2 * 9.8)
    np.testing.assert_allclose(height, 0.1 * 0.49, rtol=1e-6)
