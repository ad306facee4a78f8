"""Offset "face" on the adapter: the core's bits in the strict class, and no triangle dips in."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.contact.table import scene_of
from clothsim.contact.triangles import distance

pytestmark = pytest.mark.usefixtures("needs_float64")

# Where an adapter rounds in another way than the core [m]; on lavapipe the bits are the same.
BOUND = {"double": 1e-11, "single": 1e-7}


@pytest.fixture
def follow(exact):
    """Both backends from one state on, every step looked at; the adapter's stepper at the end."""

    def steps(scene, dt, count, x=None, v=None, t=0.0, precision="double", look=1, watched=None):
        options = {"t": t, "precision": precision, "strict": True}
        cpu = cs.Stepper(scene, x, v, **options, threads=1)
        gpu = cs.Stepper(scene, x, v, **options, backend="gpu")
        for _ in range(count // look):
            cpu.advance(look, dt)
            gpu.advance(look, dt)
            for sphere in scene.spheres if watched is None else watched:
                assert cs.penetration(gpu.positions, sphere, gpu.time) == {
                    "points": 0.0, "triangles": 0.0,
                }  # fmt: skip
        if exact:
            for mine, cores in zip(gpu.snapshot().core[3], cpu.snapshot().core[3], strict=True):
                assert mine[0].tobytes() == cores[0].tobytes(), np.abs(mine[0] - cores[0]).max()
        else:
            assert np.abs(gpu.positions - cpu.positions).max() < BOUND[precision]
        return gpu

    return steps


def answered(scene, gpu, x, v, t, dt, count):
    """How far triangles put the cloth from where mass points alone would."""
    alone = scene.replace(spheres=tuple(s.replace(offset="none") for s in scene.spheres))
    other, _ = cs.step(alone, x, v, dt, count, t=t)
    return np.abs(gpu.positions - other).max()


@pytest.mark.parametrize(
    "name, start, dt, count",
    [("static", 0.232, 1e-4, 24), ("moving", 0.262, 1e-4, 24), ("fast", 0.0, 1e-4, 14)],
)
def test_the_papers_scenes_are_the_cores_and_nothing_dips_in(name, start, dt, count, follow):
    """From just before they touch; the fast sphere goes up through the cloth at 100 m/s."""
    scene = scene_of(name, "continuous, face")
    before = cs.Stepper(scene)
    before.advance(round(start / dt), dt)
    x, v, t = before.positions, before.velocities, before.time
    gpu = follow(scene, dt, count, x, v, t, look=2)
    assert answered(scene, gpu, x, v, t, dt, count) > 1e-6


def crumpled_fall(spheres):
    """A crumpled sheet of uneven mass on its way to the spheres at 3 m/s."""
    rng = np.random.default_rng(4)
    shape = (17, 13)
    masses = rng.uniform(0.5, 1.5, shape) * 2.0 / (shape[0] * shape[1])
    cloth = cs.Cloth(shape, mass=masses, stiffness=400.0, damping=0.05, pins=((0, 0), (8, 6)))
    x = cloth.rest_positions + rng.normal(scale=2e-3, size=(*shape, 3))
    v = np.zeros_like(x)
    v[..., 1] = -3.0
    v[cloth.pinned] = 0.0
    return cs.Scene(cloth, spheres, position=x, velocity=v)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_several_moving_rough_spheres_pins_and_single_precision(precision, follow):
    """Bounces that fly, sharing beside a pinned corner, a point sphere among them."""
    motion = cs.Linear((0.3, 1.0, 0.2))
    spheres = (
        cs.Sphere((0.3, -0.24, 0.4), 0.2, motion, "continuous", "face", 0.6, 0.3),
        cs.Sphere((0.75, -0.2, 0.5), 0.15, None, "continuous", "none", 0.2),
        cs.Sphere((0.6, -0.19, 0.7), 0.16, motion, "continuous", "face", 0.0),
    )
    scene = crumpled_fall(spheres)
    faces = spheres[::2]  # triangles may dip into the other one
    gpu = follow(scene, 5e-4, 40, precision=precision, look=4, watched=faces)
    x, v = scene.initial_position, scene.initial_velocity
    assert answered(scene, gpu, x, v, 0.0, 5e-4, 40) > 1e-4


@pytest.mark.parametrize("speed, count", [(3.0, 15), (300.0, 15), (3000.0, 2)])
def test_a_sphere_smaller_than_a_cell_is_caught(speed, count, follow):
    """Through the middle of a triangle, with no mass point near: only the triangle sees it.

    At 3000 m/s the sphere is two cells beyond the cloth at the end of the step.
    """
    cloth = cs.Cloth((8, 8), mass=2.0, stiffness=2000.0, damping=1.0, pins=())
    cell, radius = cloth.spacing[0], 0.01
    center = (3.3 * cell, -radius - 0.002, 3.25 * cell)
    sphere = cs.Sphere(
        center, radius, cs.Linear((0, speed, 0)), "continuous", "face", restitution=0.3
    )
    gpu = follow(cs.Scene(cloth, sphere), 1e-4, count)
    assert np.abs(gpu.velocities[..., 1]).max() > 0.2 * speed


def test_a_stretched_triangle_is_kept_out_as_it_is_now(follow):
    """Twice the size of the cloth at rest: eq 13 for the rest length is far too little."""
    cloth = cs.Cloth((9, 9), mass=1.0, stiffness=10.0, damping=0.5, pins=())
    x, v = 2.0 * cloth.rest_positions, np.full((9, 9, 3), (0.0, -2.0, 0.0))
    sphere = cs.Sphere((1.05, -0.32, 1.05), 0.3, None, "continuous", "face", restitution=0.0)
    scene = cs.Scene(cloth, sphere, position=x, velocity=v)
    follow(scene, 1e-3, 30)
    edge = scene.replace(spheres=(sphere.replace(offset="edge"),))
    x, _ = cs.step(edge, x, v, 1e-3, 30, backend="gpu")
    assert cs.penetration(x, sphere)["triangles"] > 5e-3


def test_a_bounce_shorter_than_a_step_leaves_with_its_part_of_the_speed(follow):
    """The sheet comes down slowly: 2 e v is below what gravity takes in a step."""
    cloth = cs.Cloth((6, 6), (0.3, 0.3), mass=1.0, stiffness=100.0, damping=0.05, pins=())
    sphere = cs.Sphere((0.13, -0.1001, 0.17), 0.1, None, "continuous", "face", restitution=0.2)
    x, v = cloth.rest_positions, np.full((6, 6, 3), (0.0, -0.02, 0.0))
    gpu = follow(cs.Scene(cloth, sphere, position=x, velocity=v), 2e-3, 6)
    alone, _ = cs.step(cs.Scene(cloth), x, v, 2e-3, 6)
    assert np.abs(gpu.positions - alone).max() > 1e-4


@pytest.mark.parametrize("shape", [(1, 18), (18, 1)])
def test_a_chain_is_kept_out_between_its_points(shape):
    cloth = cs.Cloth(
        shape, (1.0, 1.0), 0.6, 500.0, 0.2, springs=("structural",), pins=((0, 0), (-1, -1))
    )
    middle = cloth.rest_positions.reshape(-1, 3)[8:10].mean(axis=0)
    sphere = cs.Sphere(middle - (0, 0.03, 0), 0.012, None, "continuous", "face", restitution=0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere), strict=True, backend="gpu")
    for _ in range(30):
        stepper.advance(5, 1e-3)
        x = stepper.positions.reshape(-1, 3)
        links = np.stack([x[:-1], x[1:], x[1:]], axis=1) - np.array(sphere.center)
        assert distance(links).min() >= sphere.radius
    assert -0.03 < stepper.positions.reshape(-1, 3)[8:10, 1].min() < -0.01


def test_more_triangles_of_a_color_than_invocations(follow):
    """The whole sheet of 70 x 70 on the sphere: 306 triangles of a color, 256 invocations."""
    springs = "structural", "shear"
    cloth = cs.Cloth((70, 70), (0.2, 0.2), 8.0, 100.0, 0.01, springs=springs, pins=())
    x = cloth.rest_positions - cloth.rest_positions.mean(axis=(0, 1))
    x[..., 1] = np.sqrt(0.25**2 - x[..., 0] ** 2 - x[..., 2] ** 2) + 1e-4
    sphere = cs.Sphere((0, 0, 0), 0.25, None, "continuous", "face", restitution=0.0)
    v = np.zeros_like(x)
    v[..., 1] = -1.0
    gpu = follow(cs.Scene(cloth, sphere, position=x, velocity=v), 1e-4, 4)
    assert (np.abs(gpu.velocities[..., 1]) < 0.9).mean() > 0.5  # stopped nearly everywhere


def test_a_batch_has_the_bits_of_its_members(same_bits):
    ball = cs.Sphere((0.5, -0.24, 0.5), 0.2, None, "continuous", "face", 0.0)
    balls = ball, ball.replace(center=(0.5, -9, 0.5)), ball.replace(radius=0.22)
    scenes = [crumpled_fall(b) for b in balls]
    x = np.stack([s.initial_position for s in scenes])
    v = np.stack([s.initial_velocity for s in scenes])
    batch = cs.step(scenes, x, v, 5e-4, 35, precision="single", backend="gpu")
    for k, scene in enumerate(scenes):
        alone = cs.step(scene, x[k], v[k], 5e-4, 35, precision="single", backend="gpu")
        assert same_bits([part[k] for part in batch], alone)


def test_a_sphere_that_starts_on_the_cloth_pushes_out_slowly_as_in_the_core(exact):
    """Corners that start inside share their way out (`pushed`)."""
    cloth = cs.Cloth((9, 9), (0.3, 0.3), mass=0.5, stiffness=200.0, damping=0.5, pins=())
    sphere = cs.Sphere((0.15, -0.02, 0.15), 0.06, None, "continuous", "face", 0.0)
    scene, ends = cs.Scene(cloth, sphere), []
    for backend in ("cpu", "gpu"):
        with pytest.warns(cs.ContactWarning, match="starts on the cloth"):
            stepper = cs.Stepper(scene, strict=True, backend=backend)
        start = stepper.positions
        stepper.advance(10, 1e-3)
        ends.append(stepper.positions)
    assert np.abs(ends[0] - start).max() > 4e-3
    assert np.abs(ends[1] - ends[0]).max() <= (0 if exact else 1e-9)
    depths = [cs.penetration(x, sphere)["triangles"] for x in (start, *ends)]
    assert depths[1] < 0.9 * depths[0] and abs(depths[1] - depths[2]) < 1e-9


def test_speeds_of_rounding_beside_a_pin_inside(follow):
    """Triangles beside a pinned corner inside keep 1e-22 m/s inwards, however often it is taken."""
    sphere = cs.Sphere(radius=0.45, response="continuous", offset="face")
    with pytest.warns(cs.ContactWarning):
        stepper = follow(cs.Scene(cs.Cloth((10, 10)), sphere), 1e-4, 10, watched=())
    assert cs.penetration(stepper.positions, sphere)["triangles"] > 0.4  # the pinned corner


def test_spheres_that_leave_no_place_are_refused_as_in_the_core(exact, closing):
    told = []
    for backend in ("cpu", "gpu"):
        stepper = cs.Stepper(closing((3, 3)), strict=True, backend=backend)
        with pytest.raises(cs.ContactError) as error:
            stepper.advance(60, 1e-3)
        told.append((error.value.step, error.value.point))
    assert told[0] == told[1] and told[0][0] == 25


def test_a_warning_names_the_pinned_corner(diagonal_on_pins):
    stepper = cs.Stepper(diagonal_on_pins, backend="gpu")
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 1\)"):
        stepper.advance(12, 0.01)


def test_what_a_scene_does_not_ask_for_is_not_in_its_shader():
    from clothsim.gpu.shader import Features, source

    with_faces = scene_of("static", "continuous, face")
    without = scene_of("static", "continuous")
    assert "keep_faces_out" in source(Features.of(with_faces), "double", True)
    assert "keep_faces_out" not in source(Features.of(without), "double", True)
