"""The edge kernel passes rows beyond a plane beside the sphere; the gather kernel, which asks every point, is the oracle."""

import clothsim as cs
import numpy as np
import pytest
from variants import pairs


def falling(*spheres, shape=(32, 32)):
    return cs.Scene(cs.Cloth(shape, pins=()), spheres)


def same_contacts(scene, steps, dt, *, precision="double", **options):
    """Positions by the edge kernel, and its number of contacts: both those of the oracle."""
    (x, contacts), (oracle, expected) = (
        ended(cs.Stepper(scene, kernel=kernel, precision=precision, **options), steps, dt) for kernel in ("edge", "gather")
    )
    # Contact magnifies the rounding of single.
    assert contacts == pytest.approx(expected, rel=0 if precision == "double" else 5e-3)
    if precision == "double":
        np.testing.assert_allclose(x, oracle, rtol=0, atol=1e-11)
    else:  # a row that is passed by mistake is more than a point in 70
        assert np.mean(np.abs(x - oracle).max(axis=-1) > 2e-3) < 1 / 70
    return x, contacts


def ended(stepper, steps, dt):
    stepper.advance(steps, dt)
    return stepper.positions, sum(stepper._state.core.contacts)


@pairs(
    precision=["double", "single"],
    shape=[(32, 32), (9, 20), (5, 33), (64, 48)],
    way=[(axis, side) for axis in range(3) for side in (-1, 1)],
)
def test_from_every_side(precision, shape, way):
    """Spheres that come in along an axis, as fast as they leave the plane behind within a step."""
    axis, side = way
    center = np.full(3, 0.5) * (1, 0, 1)
    center[axis] += side * 0.9
    toward = np.zeros(3)
    toward[axis] = -side
    for speed in (5.0, 500.0):
        ball = cs.Sphere(tuple(center), 0.2, motion=cs.Linear(tuple(speed * toward)), response="ray", offset="edge")
        way = 0.9 if axis == 1 else 0.3  # m, into the contact, before it magnifies rounding
        assert same_contacts(falling(ball, shape=shape), round(way / speed / 2e-4), 2e-4, precision=precision)[1]


def test_a_sphere_that_jumps(precision):
    """A motion by table that goes from out of reach into the cloth between two steps."""
    times = [0.0, 0.0100, 0.01001, 1.0]
    centers = [(0.5, -50.0, 0.5), (0.5, -50.0, 0.5), (0.5, -0.1, 0.5), (0.5, -0.1, 0.5)]
    ball = cs.Sphere((0.5, -50.0, 0.5), 0.15, motion=cs.Keyframes(times, centers), response="ray", offset="edge")
    assert same_contacts(falling(ball), 300, 1e-4, precision=precision)[1]


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_points_that_are_fast(threads):
    """One corner is thrown at the sphere: it is there within a few steps, the rest is not."""
    scene = falling(cs.Sphere((0.0, -0.33, 0.0), 0.3, response="ray", offset="edge"))
    v = np.zeros_like(scene.initial_position)
    v[:2, :2, 1] = -200.0
    assert same_contacts(scene, 200, 5e-5, v=v, threads=threads)[1]


def test_several_spheres_and_a_batch(same_bits):
    """Each sphere has its own plane, each member and each of its bands too."""
    balls = (
        cs.Sphere((0.5, -0.3, 0.5), 0.2, response="ray", offset="edge"),
        cs.Sphere((3.0, 0.0, 0.5), 0.2, response="ray", offset="edge"),
        cs.Sphere((0.2, -0.15, 0.2), 0.1, response="ray", offset="edge"),
        cs.Sphere((0.5, -9.0, 0.5), 0.2, response="reflect", offset="edge"),
    )
    scenes = [falling(*balls), falling(balls[1]), falling(*balls[2:])]
    x = np.stack([s.initial_position for s in scenes])
    v = np.zeros_like(x)
    together = cs.step(scenes, x, v, 1e-4, 2500, kernel="edge", threads=2)
    for k, scene in enumerate(scenes):
        alone, contacts = same_contacts(scene, 2500, 1e-4)
        assert (contacts > 0) == (k != 1)
        assert same_bits([together[0][k]], [alone])
