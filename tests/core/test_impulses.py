"""Impulses on spheres: momentum that a cloth without pins and gravity lost, sphere by sphere."""

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from variants import FIXED, cases, pairs

DT = 5e-4
STEPS = 240
CONTACTS = [("reflect", "edge"), ("ray", "none"), ("ray", 0.01), ("ray", "cell")]
CLOTH = cs.Cloth(
    (12, 20),
    mass=np.linspace(1e-3, 5e-3, 240).reshape(12, 20),
    stiffness=60.0,
    damping=0.02,
    pins=(),
)
ROUNDING = {
    "double": 1e-12,
    "single": 1e-7,
}  # in single the forces of the springs are not exactly opposite
PLACES = {
    1: [((0.5, -0.3, 0.5), 0.25, (0.2, 0.5, 0.1))],
    3: [
        ((0.3, -0.3, 0.3), 0.2, (0.0, 0.4, 0.0)),
        ((0.7, -0.3, 0.6), 0.25, (0, 0, 0)),
        ((0.5, -0.3, 0.5), 0.2, (0, 0, 0)),
    ],
}


def scene_of(contact, count, cloth=CLOTH, **material):
    """Return a sheet that falls at 2 m/s on one sphere, or on three that overlap."""
    response, offset = contact
    material = {"restitution": 0.3, "friction": 0.2, **material}
    spheres = [
        cs.Sphere(c, r, cs.Linear(v), response, offset, **material) for c, r, v in PLACES[count]
    ]
    v = np.where(cloth.pinned[..., None], 0.0, (0.1, -2.0, 0.0))
    return cs.Scene(cloth, spheres, gravity=(0, 0, 0), velocity=v)


def momentum(cloth, v):
    """Of the points that are not pinned [N s]."""
    return (np.where(cloth.pinned, 0.0, cloth.mass_per_point)[..., None] * v).sum(axis=(-3, -2))


def lost(stepper, scene):
    return -(
        momentum(scene.cloth, stepper.velocities) - momentum(scene.cloth, scene.initial_velocity)
    )


def off(impulses, momentum_lost):
    """Distance of the sum over spheres from the momentum, as part of the largest impulse."""
    assert np.abs(impulses).max() > 0.05
    return np.abs(impulses.sum(axis=-2) - momentum_lost).max() / np.abs(impulses).max()


@cases(contact=CONTACTS, count=[1, 3])
def test_impulses_are_the_momentum_that_the_cloth_has_lost(variant, contact, count):
    gravity = np.array((0.0, -9.8125, 0.0))  # a number of both precisions
    scene = scene_of(contact, count).replace(gravity=gravity)
    stepper = cs.Stepper(scene, **variant.options)
    stepper.advance(STEPS, DT)
    assert stepper.impulses.shape == (count, 3)
    weight = CLOTH.mass_per_point.sum() * gravity
    assert (
        off(stepper.impulses, lost(stepper, scene) + weight * STEPS * DT)
        < ROUNDING[variant.precision]
    )


@pytest.mark.filterwarnings("ignore::clothsim.OrderWarning", "ignore::clothsim.StabilityWarning")
@pairs(integrator=FIXED, contact=CONTACTS, count=[1, 3], precision=["double", "single"])
def test_with_every_integrator(integrator, contact, count, precision):
    scene = scene_of(contact, count)
    stepper = cs.Stepper(scene, integrator=integrator, precision=precision)
    stepper.advance(STEPS, DT)
    assert off(stepper.impulses, lost(stepper, scene)) < ROUNDING[precision]


@pytest.mark.parametrize("contact", CONTACTS)
def test_members_of_a_batch_with_fewer_spheres_have_no_impulses_of_the_others(contact):
    scenes = [scene_of(contact, count) for count in (1, 3)]
    batch, *singles = cs.Stepper(scenes), *map(cs.Stepper, scenes)
    for stepper in (batch, *singles):
        stepper.advance(STEPS, DT)
    assert batch.impulses.shape == (2, 3, 3) and np.isnan(batch.impulses[0, 1:]).all()
    assert (batch.impulses[0, :1] == singles[0].impulses).all() and (
        batch.impulses[1] == singles[1].impulses
    ).all()


@pytest.mark.parametrize("contact", CONTACTS)
def test_spheres_apart_get_what_each_gets_alone(contact):
    """Without springs the points above one sphere know nothing of the others."""
    cloth = cs.Cloth((12, 40), mass=1.0, stiffness=0.0, damping=0.0, pins=())
    spheres = [
        cs.Sphere((x, -0.2, 0.5), 0.15, None, *contact, restitution=0.4, friction=0.2)
        for x in (0.2, 0.5, 0.8)
    ]
    v = np.zeros((*cloth.shape, 3)) + (0.1, -2.0, 0.0)
    joint = cs.Stepper(cs.Scene(cloth, spheres, velocity=v))
    joint.advance(100, DT)
    for sphere, impulse in zip(spheres, joint.impulses, strict=True):
        single = cs.Stepper(cs.Scene(cloth, sphere, velocity=v))
        single.advance(100, DT)
        np.testing.assert_allclose(
            impulse, single.impulses[0], rtol=0, atol=np.abs(impulse).max() * 1e-12
        )
        assert impulse[1] < -0.01


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("contact", CONTACTS)
def test_pins_take_no_momentum_and_without_springs_single_is_as_exact(contact, precision):
    cloth = cs.Cloth((6, 8), mass=1.0, stiffness=0.0, damping=0.0, pins=((2, 3), (3, 4), (0, 0)))
    scene = scene_of(contact, 3, cloth)
    stepper = cs.Stepper(scene, precision=precision)
    stepper.advance(STEPS, DT)
    assert off(stepper.impulses, lost(stepper, scene)) < 1e-12


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("contact", CONTACTS)
def test_points_that_start_inside_lose_their_inward_motion_to_the_spheres(contact, count):
    scene = scene_of(contact, count)
    risen = [sphere.replace(center=np.add(sphere.center, (0, 0.2, 0))) for sphere in scene.spheres]
    stepper = cs.Stepper(scene.replace(spheres=risen))
    stepper.advance(20, DT)
    assert off(stepper.impulses, lost(stepper, scene)) < 1e-12


# Whole runs


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize(
    "options", [{"dt": DT}, {"rtol": 1e-4}, {"rtol": 1e-4, "integrator": "dopri5"}]
)
def test_the_report_has_the_momentum_of_its_run(contact, options):
    scene = scene_of(contact, 1)
    run = cs.simulate(scene, 0.1, **options)
    impulse = np.array(run.report["impulse"])
    assert impulse.shape == (1, 3) and run.report["impulse_reason"] == ""
    assert off(impulse, momentum(CLOTH, run.v[0]) - momentum(CLOTH, run.v[-1])) < 1e-12


# Threads


def test_each_row_of_points_has_sums_of_its_own():
    side = int(np.ceil(np.sqrt(2 * _core.heuristics["points_per_thread_of_response"])))
    cloth = cs.Cloth((side, side), mass=1.0, stiffness=60.0, damping=0.01, pins=())
    ball = cs.Sphere(
        (0.5, -10.02, 0.5), 10.0, response="ray", offset=0.01, restitution=0.0, friction=0.3
    )
    scene = cs.Scene(cloth, ball, velocity=np.broadcast_to((0.1, -2.0, 0.0), (side, side, 3)))
    first, second = (cs.Stepper(scene, threads=threads) for threads in (1, 2))
    for stepper in (first, second):
        stepper.advance(60, 2e-4)
    sums, second_sums = (stepper.snapshot().core["impulses"] for stepper in (first, second))
    of_rows = sums[0, :, :, 1].sum(axis=-1)
    assert of_rows.min() > 0.05 * of_rows.sum()  # the sheet pushes downwards
    assert (sums == second_sums).all()
