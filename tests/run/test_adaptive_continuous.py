"""Error control together with continuous contact: no contact is skipped, at any speed."""

import clothsim as cs
import numpy as np
import pytest

ADAPTIVE = ("dop853", "dopri5")


def free_cloth(shape=(16, 16)):
    return cs.Cloth(shape=shape, mass=25.6, stiffness=100.0, damping=0.0, pins=())


@pytest.mark.parametrize("response, offset", [("continuous", "none"), ("continuous", "cell"), ("ray", "edge")])
@pytest.mark.parametrize("integrator", ADAPTIVE)
def test_no_contact_is_skipped_at_100_metres_a_second(integrator, response, offset):
    """A sphere through a free cloth: what it meets leaves at twice its speed, at whatever tolerance."""
    sphere = cs.Sphere((0.5, -1.0, 0.5), 0.2, cs.Linear((0.0, 100.0, 0.0)), response, offset, restitution=1.0)
    scene = cs.Scene(free_cloth(), sphere, gravity=(0.0, 0.0, 0.0))
    run = cs.simulate(scene, 0.02, rtol=1e-2, integrator=integrator, every=1e-3)
    small = cs.simulate(scene, 0.02, dt=1e-5)
    met, expected = (np.linalg.norm(r.v[-1], axis=-1) > 50 for r in (run, small))
    assert expected.sum() >= 28
    if offset != "cell":  # whose radius grows with the cells, by how much depends on the step
        assert (met == expected).all()
    assert met.sum() >= 28
    # No step near the sphere was longer than a tenth of its contact radius at its speed.
    assert 20 <= run.report["steps"] < 250
    if response == "continuous":
        assert run.report["penetration"]["points"] < 1e-12
    if offset == "cell":
        assert run.report["penetration"]["triangles"] < 1e-6
    first = run.report["first_contact"]["time"]
    assert abs(first - (1.0 - sphere.contact_radius(scene.cloth)) / 100.0) < 5e-4


@pytest.mark.parametrize("integrator", ADAPTIVE)
def test_a_grazing_contact_within_a_step_gets_a_response(integrator):
    """Both ends of the step are outside; the chord dips in by a hair: the response at the end of a
    step alone would not see it."""
    cloth = cs.Cloth((1, 2), (1.0, 1.0), mass=2.0, stiffness=0.0, damping=0.0, pins=())
    radius, depth, speed = 0.5, 2e-4, 10.0
    sphere = cs.Sphere((0.0, 0.0, 0.0), radius, response="continuous", offset="none", restitution=1.0)
    position = np.array([[[-1.0, radius - depth, 0.0], [-1.0, 5.0, 0.0]]])
    velocity = np.array([[[speed, 0.0, 0.0], [speed, 0.0, 0.0]]])
    scene = cs.Scene(cloth, sphere, (0.0, 0.0, 0.0), position, velocity)
    run = cs.simulate(scene, 0.2, rtol=1e-3, integrator=integrator)
    assert run.v[-1][0, 0, 1] > 0.05  # turned aside
    assert run.v[-1][0, 1].tolist() == [speed, 0.0, 0.0]


def test_a_point_trapped_is_an_error_at_the_step_before(trap):
    with pytest.raises(cs.ContactError) as caught:
        cs.simulate(trap(), 1.0, rtol=1e-3, integrator="dop853")
    error = caught.value
    assert error.point == (0, 0) and 0.09 < error.time < 0.5 and error.step >= 1
    start = trap().initial_position
    assert error.x.tobytes() == start.tobytes() or error.step > 1  # the state before that step
