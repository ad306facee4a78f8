"""Steps of one or two triangles that meet a sphere, in figures."""

import warnings

import clothsim as cs
import numpy as np
import pytest
from contact_fuzz.exact import distance

DT = 0.01


@pytest.mark.parametrize("kernel", ["edge", "gather"])
@pytest.mark.parametrize("way", [1, -1])
def test_a_sphere_that_crosses_a_triangle_within_a_step_is_stopped_from_either_side(kernel, way):
    """Between the corners, from far off to far off: a triangle is looked at along the whole way.

    What is known of a triangle from the step before may not hide it: the first step is far away.
    """
    cloth = cs.Cloth((2, 2), mass=4.0, stiffness=0.0, damping=0.0, pins=())
    center, radius = np.array((0.25, 0.0, 0.25)), 0.05
    # At the side of the cloth first, where its direction is +y or -y, then through it in one step.
    motion = cs.Keyframes([0.0, DT, 2 * DT], center + np.array([(0, -1.4, 0), (0, -1.0, 0), (0, 1.0, 0)]) * way)
    sphere = cs.Sphere((0, 0, 0), radius, motion, "continuous", "face", 0.0, 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0)), kernel=kernel)
    stepper.advance(1, DT)
    assert (stepper.velocities == 0).all()
    stepper.advance(1, DT)
    # At the weights (1/2, 1/4, 1/4) of three corners of 1 kg: shares 4/3, 2/3, 2/3 of 200 m/s, and
    # 2 % more, as the triangle that tilts meets the sphere again. The fourth corner stays.
    expected = np.array([[4.0, 2.0], [2.0, 0.0]]) / 3 * 200.0 * way
    np.testing.assert_allclose(stepper.velocities[..., 1], expected, rtol=0.03, atol=1e-9)
    assert cs.penetration(stepper.positions, sphere, 2 * DT)["triangles"] == 0


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_triangle_that_starts_inside_is_pushed_out_at_the_speed_of_the_push():
    """The middle of a diagonal: its two corners alone, by push_out_speed dt a step, to the rim."""
    cloth = cs.Cloth((2, 2), mass=4.0, stiffness=0.0, damping=0.0, pins=())
    radius, depth, push = 0.3, 0.011, 0.4
    sphere = cs.Sphere((0.5, depth - radius, 0.5), radius, None, "continuous", "face", push_out_speed=push, restitution=1.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0)))
    for k in range(1, 6):
        stepper.advance(1, DT)
        y = stepper.positions[..., 1]
        expected = min(k * push * DT, depth)
        bound = 1e-4 if expected == depth else 1e-6  # at last both triangles push, already tilted
        np.testing.assert_allclose((y[0, 1], y[1, 0]), expected, rtol=0, atol=bound)
        assert np.abs([y[0, 0], y[1, 1]]).max() < 1e-4
        assert (stepper.velocities == 0).all()


@pytest.mark.parametrize("pins", [((0, 0), (0, 1)), ((0, 1),)], ids=["both ends", "one end"])
def test_a_sphere_between_pinned_points_warns_when_it_touches(pins):
    """A link of 1 m: pinned at both ends nothing can move, with one free that end swings clear."""
    cloth = cs.Cloth((1, 2), (1.0, 1.0), 2.0, 0.0, 0.0, springs=("structural",), pins=pins)
    motion = cs.Linear((0, 1.0, 0))
    sphere = cs.Sphere((0.5, -0.2, 0.0), 0.1, motion, "continuous", "face", 0.0, 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.advance(9, DT)  # they touch at 0.1 s
        assert (stepper.velocities == 0).all()
        if len(pins) == 1:
            stepper.advance(2, DT)
            # 0.01 m higher in the middle, 0.02 at the free end, at twice the sphere's speed.
            np.testing.assert_allclose(stepper.velocities[0, 0, 1], 2.0, rtol=0.01)
            np.testing.assert_allclose(stepper.positions[0, 0, 1], 0.02, rtol=0.02)
            return
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 0\)"):
        stepper.advance(2, DT)
    assert (stepper.velocities == 0).all()
    np.testing.assert_array_equal(stepper.positions, cloth.rest_positions)


@pytest.mark.parametrize("way", [2e-4, 1e-3, 5e-3])
def test_a_link_turns_between_two_spheres(way):
    """One comes from below at a quarter, one from above at three quarters; there is a place.

    Velocities are judged where the link touches first, within 1e-3 of where it ends. The
    link turns by the angle q, 0.25 sin q + (0.1 - way/2) cos q = 0.1, and touches them at a part
    0.25 + 0.1 sin q of its length, so that its ends go at a little more than twice their speed.
    """
    middle = np.hypot(0.25, 0.1 - way / 2)
    angle = np.arcsin(0.1 / middle) - np.arctan2(0.1 - way / 2, 0.25)
    speed = way / (1 - 2 * (0.25 + 0.1 * np.sin(angle)))
    cloth = cs.Cloth((1, 2), (1.0, 1.0), 2.0, 0.0, 0.0, springs=("structural",), pins=())
    spheres = [
        cs.Sphere(
            (0.5 - 0.25 * up, -0.1 * up * (1 + 1e-8 + 5 * way), 0),
            0.1,
            cs.Linear((0, up * way / DT, 0)),
            "continuous",
            "face",
            0.0,
            0.0,
        )
        for up in (1, -1)
    ]
    stepper = cs.Stepper(cs.Scene(cloth, spheres, (0, 0, 0)))
    stepper.advance(1, DT)
    y, u = stepper.positions[0, :, 1], stepper.velocities[0, :, 1] * DT
    np.testing.assert_allclose(y, np.tan(angle) / 2 * np.array((1, -1)), rtol=1e-4, atol=2e-7)
    np.testing.assert_allclose(u, (speed, -speed), rtol=1e-3, atol=3e-7)
    x = stepper.positions[0]
    for sphere in spheres:
        assert distance(x[[0, 1, 1]] - sphere.center_at(DT)) >= sphere.radius


def test_an_early_touch_by_a_sphere_far_off_at_the_end_of_the_step_is_found():
    """It strokes the cell near its last corner from below and goes on 4 m aside in the same step."""
    cloth = cs.Cloth((2, 2), mass=4.0, stiffness=0.0, damping=0.0, pins=())
    radius, gap, way = 0.05, 0.01, np.array((4.0, 0.5, 0.0))
    start = np.array((0.8, -radius - gap, 0.8))
    sphere = cs.Sphere(start, radius, cs.Linear(way / DT), "continuous", "face", 0.0, 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0)))
    stepper.advance(1, DT)
    place = (start + gap / way[1] * way)[[0, 2]]
    corners = cloth.rest_positions.reshape(4, 3)[1:, [0, 2]]
    weights = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [*place, 1.0])
    assert weights.min() > 0.05
    expected = weights / (weights @ weights) * way[1] / DT
    np.testing.assert_allclose(stepper.velocities.reshape(4, 3)[1:, 1], expected, rtol=1e-5)
    np.testing.assert_allclose(stepper.positions.reshape(4, 3)[1:, 1], expected * DT * (1 - gap / way[1]), rtol=1e-5)
    assert (stepper.velocities[0, 0] == 0).all()
    np.testing.assert_allclose(stepper.velocities[..., ::2], 0, atol=1e-9)
