"""Continuous contact where it is hard: several spheres, pins, a start inside, wrong arguments."""

import pickle
import warnings
from functools import partial

import clothsim as cs
import numpy as np
import pytest
from contact import cone

FREE = {"stiffness": 0.0, "damping": 0.0}


def lone(position, spheres, velocity=(0.0, 0, 0), gravity=(0, 0, 0), pinned=False):
    """One mass point that matters, and one far away."""
    cloth = cs.Cloth((1, 2), pins=((0, 1), (0, 0)) if pinned else ((0, 1),), **FREE)
    x = np.array([[position, (90.0, 90, 90)]])
    v = np.array([[velocity, (0.0, 0, 0)]])
    return cs.Scene(cloth, spheres, gravity, x, v)


def ball(center, radius=0.5, **arguments):
    material = {"response": "continuous", "offset": "none", "restitution": 1.0}
    return cs.Sphere(center, radius, **{**material, **arguments})


def distances(stepper, spheres):
    return [
        float(np.linalg.norm(stepper.positions[0, 0] - s.center_at(stepper.time))) for s in spheres
    ]


def test_a_point_falls_into_the_wedge_of_two_spheres_and_rests_there(kernel, precision):
    spheres = [ball((-0.4, 0, 0), restitution=0.0), ball((0.4, 0, 0), restitution=0.0)]
    stepper = cs.Stepper(
        lone((0.02, 0.6, 0.0), spheres, gravity=(0, -9.8, 0)), kernel=kernel, precision=precision
    )
    for _ in range(200):
        stepper.advance(50, 1e-4)
        assert min(distances(stepper, spheres)) >= 0.5
    np.testing.assert_allclose(stepper.positions[0, 0], (0, 0.3, 0), rtol=0, atol=1e-6)
    assert np.abs(stepper.velocities).max() < 1e-3


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_point_inside_one_of_two_spheres_goes_out_no_faster_than_the_push():
    """As beside a single sphere: by a millimetre in a step of a millisecond."""
    spheres = [ball((0, 0, 0), 1.0, push_out_speed=1.0), ball((9.0, 9.0, 9.0))]
    stepper = cs.Stepper(lone((0.8, 0, 0), spheres))
    for step in range(1, 4):
        stepper.advance(1, 1e-3)
        np.testing.assert_allclose(
            stepper.positions[0, 0], (0.8 + 1e-3 * step, 0, 0), rtol=0, atol=1e-12
        )


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("kernel", ["edge", "gather", "reference"])
def test_a_point_between_two_spheres_ends_on_their_common_circle(kernel):
    """The push out of one leads into the other, again and again, as the wedge between is sharp."""
    spheres = [ball((0, 0, 0), 0.5, push_out_speed=1e6), ball((0.85, 0, 0), 0.4)]
    scene = lone((0.44, 0.02, -0.01), spheres)
    state = scene.initial_position, scene.initial_velocity
    step = cs.reference_step if kernel == "reference" else partial(cs.step, kernel=kernel)
    x, _ = step(scene, *state, 1e-3, t=0.0)
    along = (0.85**2 + 0.5**2 - 0.4**2) / (2 * 0.85)
    height = np.sqrt(0.5**2 - along**2)
    np.testing.assert_allclose(
        x[0, 0], (along, height * 2 / np.sqrt(5), -height / np.sqrt(5)), rtol=0, atol=1e-12
    )


def test_a_point_that_is_trapped_is_refused_with_a_clear_word(trap):
    scene = trap()
    stepper = cs.Stepper(scene)
    with pytest.raises(cs.ContactError, match=r"trapped between spheres.*further apart") as caught:
        stepper.advance(1000, 1e-3)
    error = caught.value
    assert error.point == (0, 0) and 0.09 < error.time < 0.2 and error.member is None
    assert abs(error.step - error.time / 1e-3) < 1e-6
    np.testing.assert_array_equal(error.x, stepper.positions)
    assert np.isclose(stepper.time, error.time - 1e-3)
    assert min(distances(stepper, scene.spheres)) >= 4.0
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_sphere_that_runs_into_a_pinned_point_warns_once_and_the_point_stays():
    sphere = ball((0, -1, 0), motion=cs.Linear((0, 1, 0)))
    stepper = cs.Stepper(lone((0, 0, 0), sphere, pinned=True))
    stepper.advance(400, 1e-3)
    with pytest.warns(
        cs.ContactWarning, match=r"pinned mass point \(0, 0\).*no contact moves it"
    ) as seen:
        stepper.advance(200, 1e-3)
    assert len(seen) == 1 and seen[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.advance(100, 1e-3)
    np.testing.assert_array_equal(stepper.positions[0, 0], 0)
    assert (stepper.velocities[0, 0] == 0).all()


@pytest.mark.parametrize("offset", ["none", "cell"])
def test_a_start_inside_warns_and_is_pushed_out_without_a_burst(precision, offset):
    """No point is moved faster than push_out_speed, and nothing is thrown."""
    cloth = cs.Cloth((16, 16), mass=4.0, stiffness=100.0, damping=0.5, pins=())
    sphere = cs.Sphere(
        (0.5, -0.2, 0.5), 0.25, None, "continuous", offset, restitution=0.0, push_out_speed=0.4
    )
    scene = cs.Scene(cloth, sphere, gravity=(0, 0, 0))
    center = np.array(sphere.center)
    depth = sphere.radius - np.linalg.norm(cloth.rest_positions - center, axis=-1)
    count, deep = (
        (int((depth > 0).sum()), f"{depth.max():.3g}") if offset == "none" else (r"\d+", r"[\d.]+")
    )
    message = rf"spheres\[0\].*{count} mass points.*\([78], [78]\), by {deep} m.*0.4 m/s"
    stepper = cs.Stepper(scene, precision=precision)
    with pytest.warns(cs.ContactWarning, match=message) as caught:
        stepper.advance(1, 1e-3)
    assert len(caught) == 1
    if offset == "none":
        with warnings.catch_warnings(record=True) as again:
            warnings.simplefilter("always")
            cs.step(
                scene, *cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-3), 1e-3
            )
        assert len(again) == 2  # each call
    dt = 1e-3
    for _ in range(400):
        before = stepper.positions
        speed = np.linalg.norm(stepper.velocities, axis=-1)
        stepper.advance(1, dt)
        moved = np.linalg.norm(stepper.positions - before, axis=-1)
        assert (moved <= (0.4 + 1.2 * speed.max() + 0.01) * dt).all()
        assert speed.max() < 1.0
    result = cs.penetration(stepper.positions, sphere)
    assert result["points"] == 0
    if offset == "cell":
        assert result["triangles"] == 0


@pytest.mark.parametrize("offset, bound", [("none", 1e-8), ("cell", 1e-10)])
def test_the_friction_cone_from_both_sides(offset, bound):
    """tan(0.35) = 0.365: 3 % more friction holds, 3 % less slides as the formula says."""
    holds, slides, free = (cone(part * np.tan(0.35), offset=offset) for part in (1.03, 0.97, 0.0))
    assert abs(holds["slip"]) < bound
    assert 1.5e-3 < slides["slip"] < 3e-3
    np.testing.assert_allclose(slides["slip"], slides["expected"], rtol=0.02)
    np.testing.assert_allclose(free["slip"], free["expected"], rtol=0.01)


def test_float32_arrays_stay_outside_from_call_to_call():
    """step() with float32 drops the compensation at each call; the slop covers it."""
    scene = cs.scenes.paper_static("continuous", offset="none")
    x = scene.initial_position.astype(np.float32)
    v = scene.initial_velocity.astype(np.float32)
    sphere = scene.spheres[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(60):
            x, v = cs.step(scene, x, v, 4e-4, 20, precision="single")
            assert np.linalg.norm(x.astype(float) - sphere.center, axis=-1).min() >= sphere.radius
    assert (np.linalg.norm(x - sphere.center, axis=-1) < 0.2505).sum() > 10
