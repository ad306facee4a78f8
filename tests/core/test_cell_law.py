"""Law of offset "cell": bits, drapes and symmetry. Energy, rest and friction are those of test_continuous.py."""

import clothsim as cs
import numpy as np
import pytest
from contact.drape_cost import SCENES


def draped(centre):
    """The state of a sheet that has fallen on a rough sphere."""
    cloth = cs.Cloth((16, 16), mass=0.3, stiffness=60.0, damping=0.02, pins=())
    velocity = np.broadcast_to((0.0, -3.0, 0.0), (16, 16, 3))
    stepper = cs.Stepper(cs.Scene(cloth, cs.Sphere(centre, 0.25, friction=0.2), velocity=velocity), kernel="gather")
    stepper.advance(200, 2e-4)
    return stepper.positions, stepper.velocities


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_sphere_that_comes_and_goes_changes_no_bits(same_bits):
    """rho is kept from step to step where points touch; here rows begin and cease to touch."""
    cloth = cs.Cloth((24, 24), mass=0.3, stiffness=60.0, damping=0.02, pins=())
    ball = cs.Sphere((0.1, -0.099, 0.5), 0.1, cs.Linear((4.0, 0.8, 0.0)), friction=0.2)
    scene = cs.Scene(cloth, ball)
    whole = cs.Stepper(scene)
    whole.advance(400, 2e-4)
    parts = cs.Stepper(scene)
    for _ in range(100):
        parts = cs.Stepper.restore(parts.snapshot())
        parts.advance(4, 2e-4)
    assert same_bits((whole.positions, whole.velocities), (parts.positions, parts.velocities))
    assert np.abs(whole.velocities).max() > 1


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("name", SCENES)
def test_no_triangle_is_inside_at_any_step_of_a_drape(name):
    cloth, balls, speed, duration, dt = SCENES[name]
    velocity = np.broadcast_to((0.0, -speed, 0.0), (*cloth.shape, 3))
    scene = cs.Scene(cloth, [ball.replace(offset="cell") for ball in balls], velocity=velocity)
    for precision in ("double", "single"):
        report = cs.simulate(scene, duration, dt=dt, precision=precision).report
        assert report["penetration"]["points"] == report["penetration"]["triangles"] == 0
        assert np.isfinite(report["first_contact"]["time"])


def test_a_mirrored_scene_stays_mirrored():
    """Across both axes and the diagonal of the sheet, whose triangles then have the other diagonal."""
    x, v = draped((0.42, -0.26, 0.55))
    nearest = np.linalg.norm(x - (0.42, -0.26, 0.55), axis=-1).min()
    assert nearest < 0.255
    for centre, back, flip in (
        ((0.58, -0.26, 0.55), lambda a: a[:, ::-1], (-1, 1, 1)),
        ((0.42, -0.26, 0.45), lambda a: a[::-1], (1, 1, -1)),
        ((0.55, -0.26, 0.42), lambda a: a.transpose(1, 0, 2)[..., ::-1], (1, 1, 1)),
    ):
        y, w = draped(centre)
        corner = np.array([0.5, 0.0, 0.5])
        assert np.abs((back(y) - corner) * flip - (x - corner)).max() < 1e-9
        assert np.abs(back(w) * flip - v).max() < 1e-6
