"""One set of bits of every feature: on any number of threads, cut into calls, from a snapshot's
file, and in a batch.
"""

import functools
import itertools

import clothsim as cs
import numpy as np
import pytest
from pairwise import pairwise
from variants import FIXED, NAMED_KERNELS, PRECISIONS

SWING = cs.Reciprocate((1.0, 0.5, -0.3), distance=0.3, period=1.0, deceleration=3.0)


@functools.cache
def drape(_):
    """Return the paper's cloth on its sphere, after 0.22 s."""
    scene = cs.scenes.paper_static(bend=True)
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 5e-4, 440)
    return scene.replace(position=x, velocity=v), 5e-4, 40


def collision(_, response, offset, shape=(40, 37)):
    """Return a sheet that falls on three spheres, two of which overlap and one of which moves."""
    material = {"response": response, "offset": offset, "friction": 0.2}
    if response != "penalty":
        material["restitution"] = 0.3
    places = ((0.3, 0.2, 0.4), (0.7, 0.25, 0.0), (0.5, 0.2, 0.0))
    spheres = [
        cs.Sphere((x, -0.3, 0.5), radius, cs.Linear((0, speed, 0)), **material)
        for x, radius, speed in places
    ]
    cloth = cs.Cloth(shape, mass=1.0, stiffness=100.0, damping=0.02, pins=())
    return cs.Scene(cloth, spheres, velocity=np.zeros((*shape, 3)) + (0.1, -2.0, 0.0)), 5e-4, 80


def driven_pins(crumpled):
    side = [(row, 0) for row in range(33)]
    scene, x, v, dt = crumpled(shape=(33, 40), pins=side)
    v[:, 0] = SWING.velocity_at(0.0)
    return (
        scene.replace(
            cloth=scene.cloth.replace(pins=dict.fromkeys(side, SWING)), position=x, velocity=v
        ),
        dt,
        9,
    )


def forced(crumpled, place):
    scene, x, v, dt = crumpled(shape=(33, 40))
    force = 3.0 * np.random.default_rng(5).normal(size=x.shape)
    return scene.replace(position=x + place, velocity=v, force=force), dt, 9


def cases():
    for integrator, kernel, precision in pairwise(FIXED, NAMED_KERNELS, PRECISIONS):
        yield drape, {"integrator": integrator, "kernel": kernel, "precision": precision}
    for integrator, precision in itertools.product(
        ("rk4", "velocity_verlet", "pefrl", "dopri5"), PRECISIONS
    ):
        yield driven_pins, {"integrator": integrator, "precision": precision}
    contacts = [
        ("reflect", "edge"),
        *(("ray", offset) for offset in ("none", 0.01, "cell")),
        *(("penalty", offset) for offset in ("none", "cell")),
    ]
    for (response, offset), kernel, precision in pairwise(contacts, NAMED_KERNELS, PRECISIONS):
        make = functools.partial(collision, response=response, offset=offset)
        yield make, {"kernel": kernel, "precision": precision}
    for response in ("ray", "penalty"):  # contact has a second thread from 2 x 8,192 points on
        yield functools.partial(collision, response=response, offset="cell", shape=(129, 131)), {}
    for place, kernel, precision in pairwise(
        [(0, 0, 0), (1e6, -1e5, 0)], NAMED_KERNELS, PRECISIONS
    ):
        yield functools.partial(forced, place=place), {"kernel": kernel, "precision": precision}


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("make, options", list(cases()))
def test_one_set_of_bits(make, options, crumpled, same_bits, tmp_path):
    scene, dt, steps = make(crumpled)
    if options.get("integrator") == "implicit_midpoint":  # at the price of its steps
        steps = 2

    def stepped(scenes, cuts=(steps,), threads=1):
        stepper = cs.Stepper(scenes, threads=threads, **options)
        for k, count in enumerate(cuts):
            if k > 0:
                stepper = cs.Stepper.restore(
                    cs.Snapshot.load(stepper.snapshot().save(tmp_path / "state"))
                )
            stepper.advance(count, dt)
        return stepper.positions, stepper.velocities, stepper.impulses

    expected = stepped(scene)
    cuts = (steps // 2, steps - steps // 2)
    assert steps < 40 or np.abs(expected[2]).max() > 0.01  # contact
    for threads in (2, 3):
        assert same_bits(stepped(scene, threads=threads), expected)
    assert same_bits(stepped(scene, cuts), expected)
    batch = stepped([scene, scene.replace(gravity=(0.1, -3.0, 0.2)), scene], cuts, threads=2)
    assert [same_bits([part[k] for part in batch], expected) for k in (0, 1, 2)] == [
        True,
        False,
        True,
    ]
