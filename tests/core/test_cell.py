"""Offset "cell": no triangle dips in, each point stands off by what its cells need."""

import warnings

import clothsim as cs
import numpy as np
import pytest
from cell_oracle import circle_radius, point_radii, respond
from contact.drape_cost import SCENES


def sheet(n=12, **changes):
    return cs.Cloth(
        shape=(n, n), **{"mass": 0.3, "stiffness": 60.0, "damping": 0.02, "pins": (), **changes}
    )


def ball(center, radius, motion=None, **changes):
    return cs.Sphere(center, radius, motion, **{"response": "continuous", **changes})


def falling(speed=5.0, **changes):
    cloth = sheet()
    sphere = ball((0.5, -0.26, 0.5), 0.25, **changes)
    velocity = np.broadcast_to((0.0, -speed, 0.0), (*cloth.shape, 3))
    return cs.Scene(cloth, sphere, velocity=velocity)


def test_circles_of_known_triangles():
    triangles = np.array(
        [
            [[0, 0, 0], [3, 0, 0], [0, 4, 0]],
            [[0, 0, 0], [2, 0, 0], [1, 0, 3**0.5]],
            [[0, 0, 0], [4, 0, 0], [1, 0, 0.1]],
        ]
    )
    assert circle_radius(*np.moveaxis(triangles, 1, 0)) == pytest.approx(
        [2.5, 2 / 3**0.5, 2.0], rel=1e-12
    )


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_core_follows_the_oracle(friction):
    scene = falling(friction=friction)
    sphere, dt = scene.spheres[0], 2e-4
    free = scene.replace(spheres=())
    x, v = expected_x, expected_v = scene.initial_position, scene.initial_velocity
    for k in range(150):
        x, v = cs.step(scene, x, v, dt, t=k * dt)
        y, w = cs.step(free, expected_x, expected_v, dt)
        expected_x, expected_v = respond(
            sphere, expected_x, expected_v, y, w, dt, k * dt, ~scene.cloth.pinned
        )
    lying = np.linalg.norm(x - sphere.center_at(0), axis=-1) < 0.27
    assert lying.sum() > 20
    assert abs(x - expected_x).max() < 2e-6  # the stand-off is 8 mm
    assert abs(v - expected_v).max() < 2e-3  # of 5 m/s


def test_points_stand_off_by_their_cells(kernel, precision):
    scene = falling(friction=0.3)
    sphere = scene.spheres[0]
    stepper = cs.Stepper(scene, precision=precision, kernel=kernel)
    touching = 0
    for _ in range(200):
        stepper.advance(1, 2e-4)
        x = stepper.positions
        assert cs.penetration(x, sphere)["triangles"] == 0
        needed = np.sqrt(sphere.radius**2 + np.minimum(point_radii(x), sphere.radius) ** 2)
        distance = np.linalg.norm(x - sphere.center_at(0), axis=-1)
        assert (distance > needed * (1 - 1e-13)).all()
        touching = max(touching, int((distance < needed * (1 + 2e-5)).sum()))
    assert touching > 15


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


def test_between_several_spheres():
    spheres = [ball((x, -0.16, 0.5), 0.15, friction=0.2) for x in (0.3, 0.65)]
    scene = cs.Scene(
        sheet(),
        [*spheres, ball((0.5, -0.3, 0.2), 0.2, offset="edge")],
        velocity=np.full((12, 12, 3), (0, -5.0, 0)),
    )
    stepper = cs.Stepper(scene)
    for _ in range(300):
        stepper.advance(1, 2e-4)
        for sphere in spheres:
            assert cs.penetration(stepper.positions, sphere)["triangles"] == 0


def test_states_in_single_keep_triangles_out_of_steps_in_double():
    """10 m from the origin float32 rounds by more than the band above the stand-off."""
    cloth = cs.Cloth((10, 10), mass=0.4, stiffness=150.0, damping=0.02, pins=())
    floor = ball((10.5, -0.33, 0.5), 0.3, friction=0.3)
    scene = cs.Scene(cloth, floor, position=cloth.rest_positions + (10, 0, 0))
    x = scene.initial_position.astype(np.float32)
    v = np.zeros_like(x) + np.float32([0, -1, 0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(250):
            x, v = cs.step(scene, x, v, 1e-3)
            assert cs.penetration(x, floor)["triangles"] == 0


@pytest.mark.parametrize("radius", [10.0, 1e4, 1e6])
def test_a_large_sphere_is_a_floor(radius):
    """A cloth that falls on it by 1 mm comes to lie within 2 % of what its cells need."""
    cloth = cs.Cloth((12, 12), mass=0.3, stiffness=60.0, damping=0.02, drag=0.1, pins=())
    x = cloth.rest_positions.copy()
    place = np.sqrt(radius**2 - ((x[..., ::2] - 0.5) ** 2).sum(axis=-1)) - radius
    x[..., 1] = place + 1e-3
    sphere = ball((0.5, -radius, 0.5), radius)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x))
    stepper.advance(400, 1e-3)
    above = np.linalg.norm(stepper.positions - sphere.center, axis=-1) - radius
    needed = sphere.contact_radius(cloth) - radius
    assert above.min() >= 0 and above.max() < 1.02 * needed + 1e-12 * radius


def test_a_cloth_nearer_than_its_cells_allow_warns():
    slow = ball((0.5, -0.251, 0.5), 0.25, cs.Linear((0, 1.0, 0)), push_out_speed=0.1)
    with pytest.warns(cs.ContactWarning, match="1 mass points are nearer than they may be, .*4, 4"):
        cs.Stepper(cs.Scene(sheet(9), slow)).advance(1, 1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cs.Stepper(cs.Scene(sheet(9), slow.replace(center=(0.5, -0.27, 0.5)))).advance(1, 1e-6)


@pytest.mark.parametrize(
    "stretch, match", [(1, "diagonal below 0.1 m"), (20, "a stretch of its cells below 1.41")]
)
def test_a_sphere_in_the_middle_of_a_cell_warns(stretch, match):
    """All points of the cell are farther off than any point keeps from the sphere."""
    cloth = sheet(4, size=(3.0 / stretch, 3.0 / stretch), stiffness=1e-3)
    x = cloth.rest_positions * stretch
    sphere = ball((1.5, -0.1, 1.5), 0.05, cs.Linear((0, 1.0, 0)))
    scene = cs.Scene(cloth, sphere, gravity=(0, 0, 0), position=x)
    with pytest.warns(cs.ContactWarning, match=match) as caught:
        run = cs.simulate(scene, 0.1, dt=1e-3, every=1)
    assert len(caught) == 1
    assert run.report["penetration"]["triangles"] == pytest.approx(0.05, rel=0.03)


@pytest.mark.parametrize(
    "below", [None, -9.0, -0.3]
)  # a second sphere: far away; near the same points
def test_the_work_of_lifts_depends_on_no_time_step(kernel, precision, below):
    """A damped sheet of bend springs alone, whose cells grow on a sphere at rest."""
    cloth = cs.Cloth(
        (12, 12), mass=0.3, stiffness=60.0, damping=0.2, drag=0.01, springs=("bend",), pins=()
    )
    spheres = [ball((0.5, y, 0.5), 0.25) for y in (-0.26, below) if y]
    scene = cs.Scene(cloth, spheres, velocity=np.broadcast_to((0.0, -1.5, 0.0), (*cloth.shape, 3)))
    made = []
    for dt in (4e-4, 1e-4):
        with pytest.warns(
            cs.ContactWarning, match="cells that grow on a sphere have lifted .* more than 1 %"
        ):
            made.append(
                cs.simulate(scene, 0.4, dt, kernel=kernel, precision=precision).report["lift_work"]
            )
    assert made == pytest.approx([0.074] * 2, rel=0.04)


def test_a_chain_keeps_its_links_out():
    cloth = cs.Cloth(
        shape=(1, 12), size=(1.0, 1.0), mass=0.1, stiffness=100.0, damping=0.01, pins=()
    )
    sphere = ball((0.5, -0.11, 0.0), 0.1)
    stepper = cs.Stepper(cs.Scene(cloth, sphere))
    nearest = 1.0
    for _ in range(400):
        stepper.advance(1, 5e-4)
        p = stepper.positions[0] - sphere.center_at(0)
        a, d = p[:-1], p[1:] - p[:-1]
        s = np.clip(-(a * d).sum(-1) / (d * d).sum(-1), 0, 1)
        nearest = min(nearest, np.linalg.norm(a + s[:, None] * d, axis=-1).min())
    assert 0.1 <= nearest < 0.1005
