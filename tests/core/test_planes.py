"""The edge kernel passes rows that are beyond a plane beside the sphere; it misses no contact by that.

With its contact energy counted, the engine asks every mass point one by one: the oracle here.
"""

import clothsim as cs
import numpy as np
import pytest
from variants import pairs


def falling(*spheres, shape=(32, 32)):
    return cs.Scene(cs.Cloth(shape, pins=()), spheres)


def both(scene, steps, dt, *, v=None, threads=1, **options):
    """Positions and velocities by the kernel's test and by the oracle, and whether there was a contact."""
    states = []
    for tracked in (False, True):
        stepper = cs.Stepper(
            scene, v=v, kernel="edge", threads=1 if tracked else threads, track_contact_energy=tracked, **options
        )
        stepper.advance(steps, dt)
        states.append((stepper.positions, stepper.velocities))
    return *states, sum(stepper._state.core.contacts) > 0


@pairs(
    precision=["double", "single"],
    shape=[(32, 32), (9, 20), (5, 33), (64, 48)],
    way=[(axis, side) for axis in range(3) for side in (-1, 1)],
)
def test_from_every_side(precision, same_bits, shape, way):
    """Spheres that come in along an axis, as fast as they leave the plane behind within a step."""
    axis, side = way
    center = np.full(3, 0.5) * (1, 0, 1)
    center[axis] += side * 0.9
    toward = np.zeros(3)
    toward[axis] = -side
    for speed in (5.0, 500.0):
        ball = cs.Sphere(tuple(center), 0.2, motion=cs.Linear(tuple(speed * toward)), response="ray", offset="edge")
        kernel, oracle, met = both(falling(ball, shape=shape), round(0.9 / speed / 2e-4), 2e-4, precision=precision)
        assert met and same_bits(kernel, oracle), speed


def test_a_sphere_that_jumps(precision, same_bits):
    """A motion by table that goes from out of reach into the cloth between two steps."""
    times = [0.0, 0.0100, 0.01001, 1.0]
    centers = [(0.5, -50.0, 0.5), (0.5, -50.0, 0.5), (0.5, -0.1, 0.5), (0.5, -0.1, 0.5)]
    ball = cs.Sphere((0.5, -50.0, 0.5), 0.15, motion=cs.Keyframes(times, centers), response="ray", offset="edge")
    kernel, oracle, met = both(falling(ball), 300, 1e-4, precision=precision)
    assert met and same_bits(kernel, oracle)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_points_that_are_fast(threads, same_bits):
    """One corner is thrown at the sphere: it is there within a few steps, the rest is not."""
    scene = falling(cs.Sphere((0.0, -0.33, 0.0), 0.3, response="ray", offset="edge"))
    v = np.zeros_like(scene.initial_position)
    v[:2, :2, 1] = -200.0
    kernel, oracle, met = both(scene, 200, 5e-5, v=v, threads=threads)
    assert met and same_bits(kernel, oracle)


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
        kernel, oracle, met = both(scene, 2500, 1e-4)
        assert met == (k != 1)
        assert same_bits(kernel, oracle)
        assert same_bits([part[k] for part in together], kernel)


def test_large_cloth_in_waves(same_bits):
    """Rows that are finished while others have not begun."""
    ball = cs.Sphere((0.5, -0.1005, 0.5), 0.1, response="ray", offset="edge")
    v = np.zeros((300, 320, 3))
    v[..., 1] = -1.0
    kernel, oracle, met = both(falling(ball, shape=(300, 320)), 150, 5e-6, v=v)
    assert met and same_bits(kernel, oracle)
