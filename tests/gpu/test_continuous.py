"""Response "continuous" on the adapter: what the core does, and nothing passes."""

import clothsim as cs
import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("needs_float64")

BALL = cs.Sphere((0.5, -0.24, 0.5), 0.2, response="continuous", offset="edge", restitution=1.0)
LEFT = cs.Sphere((0.35, -0.22, 0.5), 0.2, response="continuous", friction=0.2, offset="edge", restitution=1.0)
RIGHT = cs.Sphere((0.62, -0.2, 0.45), 0.18, response="continuous", restitution=0.7, offset="edge")
SPHERES = {
    "one": (BALL,),
    "rough": (BALL.replace(restitution=0.5, friction=0.3),),
    "moving": (BALL.replace(motion=cs.Linear((0.5, 2.0, 0.3))),),
    "several": (LEFT, RIGHT),
    "with a ray": (BALL, cs.Sphere((0.1, -0.2, 0.1), 0.19, response="ray", offset="edge")),
}


def falling(spheres, mass="uniform", shape=(12, 14)):
    """A slightly crumpled sheet that falls on to the spheres at 3 m/s."""
    rng = np.random.default_rng(4)
    points = shape[0] * shape[1]
    masses = 2.0 if mass == "uniform" else rng.uniform(0.5, 1.5, shape) * 2.0 / points
    cloth = cs.Cloth(shape, mass=masses, stiffness=400.0, damping=0.05, pins=((0, 0),))
    x = cloth.rest_positions + rng.normal(scale=2e-3, size=(*shape, 3))
    v = np.zeros_like(x)
    v[..., 1] = -3.0
    v[cloth.pinned] = 0.0
    return cs.Scene(cloth, spheres, position=x, velocity=v)


@pytest.mark.parametrize("precision, bound", [("double", 1e-12), ("single", 1e-8)])
@pytest.mark.parametrize("name", SPHERES)
def test_it_is_what_the_core_does(name, precision, bound):
    scene, dt = falling(SPHERES[name], mass="per point" if name == "rough" else "uniform"), 5e-4
    options = {"precision": precision, "strict": True}
    cpu, gpu = cs.Stepper(scene, **options), cs.Stepper(scene, **options, backend="gpu")
    cpu.advance(80, dt)
    gpu.advance(80, dt)
    free = cs.Stepper(scene.replace(spheres=()), **options)
    free.advance(80, dt)
    assert np.abs(cpu.positions - free.positions).max() > 1e-2
    assert np.abs(gpu.positions - cpu.positions).max() < bound
    assert np.abs(gpu.velocities - cpu.velocities).max() < 1e3 * bound
    answers = gpu._state.core.contacts  # of the spheres that are not continuous
    assert answers == cpu._state.core.contacts and (answers[0] > 0) == (name == "with a ray")
    for sphere in scene.spheres:
        radius = sphere.contact_radius(scene.cloth)
        distance = np.linalg.norm(gpu.positions - sphere.center_at(gpu.time), axis=-1)
        # "ray" stays where other spheres put its points; continuous ones come last and hold.
        assert sphere.response == "ray" or distance.min() >= radius


def test_a_sphere_faster_than_its_size_a_step_does_not_pass():
    scene = falling(cs.Sphere((0.5, -1.0, 0.5), 0.1, cs.Linear((0, 600.0, 0)), "continuous", offset="edge", restitution=1.0))
    x, v = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, x, v, 5e-4, 6, t=0.0, backend="gpu")
    start = scene.initial_position
    struck = np.hypot(start[..., 0] - 0.5, start[..., 2] - 0.5) < 0.08
    assert struck.any() and (x[struck][:, 1] > 0.5).all()


def test_points_that_start_inside_go_out_at_the_cores_speed():
    ball = BALL.replace(center=(0.5, -0.1, 0.5), offset="none", push_out_speed=0.5)
    scene, ends = falling(ball), []
    x, v = scene.initial_position, 0 * scene.initial_velocity
    for backend in ("cpu", "gpu"):
        with pytest.warns(cs.ContactWarning, match="starts on the cloth"):
            ends.append(cs.step(scene, x, v, 5e-4, 20, t=0.0, strict=True, backend=backend)[0])
    assert np.abs(ends[1] - ends[0]).max() < 1e-12
    depths = [cs.penetration(positions, ball)["points"] for positions in (x, ends[1])]
    assert depths[1] == pytest.approx(depths[0] - 20 * 5e-4 * 0.5, abs=5e-4)


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_point_between_two_spheres_ends_on_their_common_circle():
    """As tests/core/test_continuous_hard.py has it for the core."""
    cloth = cs.Cloth((1, 2), stiffness=0.0, damping=0.0, pins=((0, 1),))
    spheres = [
        cs.Sphere((0, 0, 0), 0.5, response="continuous", offset="none", push_out_speed=1e6, restitution=1.0),
        cs.Sphere((0.85, 0, 0), 0.4, response="continuous", offset="none", restitution=1.0),
    ]
    x = np.array([[(0.44, 0.02, -0.01), (90.0, 90.0, 90.0)]])
    scene = cs.Scene(cloth, spheres, (0, 0, 0), x)
    x, _ = cs.step(scene, x, np.zeros_like(x), 1e-3, t=0.0, backend="gpu")
    along = (0.85**2 + 0.5**2 - 0.4**2) / (2 * 0.85)
    height = np.sqrt(0.5**2 - along**2)
    np.testing.assert_allclose(x[0, 0], (along, height * 2 / np.sqrt(5), -height / np.sqrt(5)), rtol=0, atol=1e-12)


def test_a_batch_has_the_bits_of_its_members(same_bits):
    scenes = [falling((BALL,)), falling((BALL.replace(radius=0.22),)), falling((LEFT, RIGHT))]
    x = np.stack([s.initial_position for s in scenes])
    v = np.stack([s.initial_velocity for s in scenes])
    batch = cs.step(scenes, x, v, 5e-4, 45, precision="single", backend="gpu")
    for k, scene in enumerate(scenes):
        alone = cs.step(scene, x[k], v[k], 5e-4, 45, precision="single", backend="gpu")
        assert same_bits([part[k] for part in batch], alone)


def test_points_without_a_place_are_the_cores_error():
    """Two spheres close on a point from above and below, three stand around it."""
    closing = [
        cs.Sphere((0.5, 0.35 * s, 0.5), 0.25, cs.Linear((0, -2.0 * s, 0)), "continuous", "none", restitution=1.0)
        for s in (1, -1)
    ]
    around = [
        cs.Sphere((0.5 + dx, 0, 0.5 + dz), 0.2, None, "continuous", "none", restitution=1.0)
        for dx, dz in ((0.3, 0), (-0.15, 0.26), (-0.15, -0.26))
    ]
    cloth = cs.Cloth((3, 3), mass=1.0, stiffness=10.0, damping=0.0, pins=())
    scene, errors = cs.Scene(cloth, closing + around), []
    state = scene.initial_position, scene.initial_velocity
    for backend in ("cpu", "gpu"):
        with pytest.raises(cs.ContactError) as raised:
            cs.step(scene, *state, 1e-3, 100, t=0.0, strict=True, backend=backend)
        errors.append(raised.value)
    cpu, gpu = errors
    assert gpu.step > 10
    assert (gpu.step, gpu.point, gpu.time) == (cpu.step, cpu.point, cpu.time)
    assert gpu.point == (1, 1)
    assert np.abs(gpu.x - cpu.x).max() < 1e-9


def test_a_pinned_point_in_a_sphere_is_told():
    ball = cs.Sphere((0.0, -0.5, 0.0), 0.2, cs.Linear((0, 20.0, 0)), "continuous", offset="edge", restitution=1.0)
    scene = falling(ball)
    with pytest.warns(cs.ContactWarning, match=r"run into the pinned mass point \(0, 0\)"):
        cs.step(scene, scene.initial_position, scene.initial_velocity, 5e-4, 60, t=0.0, backend="gpu")


def test_the_offset_face_is_refused():
    """Whole triangles are kept out by the core alone."""
    spheres = [cs.Sphere((9.0, 9.0, 9.0), 0.1, None, "continuous", offset, restitution=1.0) for offset in ("none", "face")]
    with pytest.raises(ValueError, match=r"^offset of spheres\[1\] must be .*, got 'face'; backend='cpu' has it$"):
        cs.Stepper(cs.Scene(cs.Cloth(), spheres), backend="gpu")
