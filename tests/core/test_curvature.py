"""Large spheres and planes: contact is measured from a place on the surface, so that no curvature
is too small.
"""

import clothsim as cs
import numpy as np
import pytest
from points import drifting
from variants import cases

CLOTH = cs.Cloth((12, 12), mass=0.3, stiffness=60.0, damping=0.02, pins=())
CONTACTS = [
    {"friction": 0.3},
    {"response": "ray", "restitution": 0.5},
    {"response": "ray", "restitution": 0.0, "friction": 0.2},
    {"response": "reflect", "restitution": 0.4},
]


def drape(obstacle, duration=0.2, **options):
    """Return a sheet that is thrown on an obstacle; its stepper."""
    x = CLOTH.rest_positions + (0, 0.1, 0)
    x[..., 1] += 0.05 * np.sin(5 * x[..., 0])
    scene = cs.Scene(
        CLOTH, obstacle, position=x, velocity=np.broadcast_to((0.3, -1.0, 0.1), x.shape)
    )
    stepper = cs.Stepper(scene, t=0.0, **options)
    dt = 1e-4 if obstacle.response == "penalty" else 5e-4
    stepper.advance(round(duration / dt), dt)
    return stepper


@pytest.mark.parametrize("radius", [1e4, 1e5])
@pytest.mark.parametrize("offset", ["none", "edge", "cell"])
def test_a_sheet_above_a_large_sphere_is_not_lifted(radius, offset, kernel, precision):
    x = CLOTH.rest_positions + (0, 0.03, 0)  # the sheet begins above the layer
    sphere = cs.Sphere((0.5, -radius, 0.5), radius, offset=offset)
    stepper = cs.Stepper(cs.Scene(CLOTH, sphere, (0, 0, 0), x), precision=precision, kernel=kernel)
    free = cs.Stepper(cs.Scene(CLOTH, (), (0, 0, 0), x), precision=precision, kernel=kernel)
    for sheet in (stepper, free):
        sheet.advance(100, 1e-3)
    np.testing.assert_array_equal(stepper.positions, free.positions)
    np.testing.assert_array_equal(stepper.velocities, free.velocities)


@pytest.mark.parametrize("contact", CONTACTS, ids=str)
def test_spheres_become_a_plane_as_they_grow(contact):
    plane = drape(cs.Plane(**contact))
    x, impulse = plane.positions, plane.impulses
    assert impulse[0, 1] < -0.2
    errors = []
    for radius in (1e2, 1e4, 1e6):
        sphere = drape(cs.Sphere((0.5, -radius, 0.5), radius, offset="none", **contact))
        errors.append(np.abs(sphere.positions - x).max())
    assert errors[0] < 0.1 and errors[1] < 0.01 and errors[2] < 1e-4


@cases(precision=["double"])
@pytest.mark.parametrize("contact", CONTACTS[1:], ids=str)  # these act after the step
def test_steps_on_a_plane_are_those_of_the_reference(variant, contact):
    rng = np.random.default_rng(5)
    plane = cs.Plane((0.0, 0.1, 0.0), (0.3, 1.0, 0.2), cs.Linear((0.5, 0.3, -0.2)), **contact)
    x = rng.uniform(-1, 1, (9, 20, 3))
    v = 3 * rng.normal(size=x.shape)
    scene = drifting(x, plane)
    expected = cs.reference_step(scene, x, v, 0.1, t=0.0)
    assert 20 < (np.abs(expected[1] - v).max(axis=-1) > 1e-6).sum() < 160
    for answer, part in zip(
        cs.step(scene, x, v, 0.1, t=0.0, **variant.options), expected, strict=True
    ):
        np.testing.assert_allclose(answer, part, rtol=0, atol=1e-10)


def test_a_plane_in_files_batches_and_runs(tmp_path, same_bits):
    scenes = [cs.Scene(CLOTH, cs.Plane((0, -height, 0), friction=0.4)) for height in (0.05, 0.1)]
    for scene in scenes:
        assert cs.Scene.from_dict(scene.to_dict()) == scene
        assert cs.load_scene(cs.save_scene(scene, tmp_path / "scene.toml")) == scene
    x = np.stack([scene.initial_position for scene in scenes])
    batch = cs.step(scenes, x, 0 * x, 1e-4, 2000)
    for k, scene in enumerate(scenes):
        assert same_bits([part[k] for part in batch], cs.step(scene, x[k], 0 * x[k], 1e-4, 2000))
        run = cs.simulate(scene, 0.3, rtol=1e-3)
        plane = scene.spheres[0]
        assert (
            run.x[-1][..., 1].min() >= plane.point[1]
            and run.report["penetration"]["triangles"] == 0
        )
        assert run.report["impulse"][0][1] < 0
