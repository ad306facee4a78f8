"""An adapter whose shaders have no float64, as Metal's: what it does, and what it refuses."""

import clothsim as cs
import numpy as np
import pytest

SINGLE = {"precision": "single", "kernel": "gather"}

pytestmark = pytest.mark.usefixtures("narrow")


def test_double_is_refused():
    with pytest.raises(
        ValueError,
        match="^precision must be 'single' on the graphics adapter .* no float64, got 'double'$",
    ):
        cs.Stepper(cs.scenes.paper_swing(), backend="gpu")


@pytest.mark.parametrize("response", ["reflect", "ray"])
def test_a_response_errs_by_units_in_the_last_place(response):
    """A cloud of free points that fly into a sphere 18 radii from the origin, in one step without
    forces.

    Farther off the state would be kept relative to an origin of its own, by the sphere.
    """
    shape = (40, 50)
    rng = np.random.default_rng(5)
    cloth = cs.Cloth(shape, stiffness=0.0, damping=0.0, pins=())
    ball = cs.Sphere(
        (1.1, -2.3, 3.7),
        0.25,
        cs.Linear((0.3, 0.1, 0.2)),
        response,
        friction=0.2,
        offset="edge",
        restitution=1.0,
    )
    scene = cs.Scene(cloth, ball, gravity=(0, 0, 0))
    direction = rng.normal(size=(*shape, 3))
    direction /= np.linalg.norm(direction, axis=-1)[..., None]
    v = rng.normal(size=(*shape, 3))
    dt = 0.5
    end = ball.center_at(dt) + direction * rng.uniform(0.05, 0.24, shape)[..., None]
    x = end - dt * v
    gpu, cpu = (
        cs.Stepper(scene, x, v, t=0.0, **SINGLE, backend=backend) for backend in ("gpu", "cpu")
    )
    for stepper in (gpu, cpu):
        stepper.advance(1, dt)
    x_gpu, v_gpu = gpu.positions, gpu.velocities
    assert np.abs(cpu.velocities - v).max() > 1
    eps = np.finfo(np.float32).eps
    # The ray may run along the surface for sqrt(eps) of the radius; it meets it to within eps
    # all the same.
    units = 40 if response == "ray" else 1
    assert np.abs(x_gpu - cpu.positions).max() < units * eps * ball.radius
    assert np.abs(v_gpu - cpu.velocities).max() < 60 * eps
    if response == "ray":
        distance = np.linalg.norm(x_gpu - ball.center_at(dt), axis=-1)
        outside = np.linalg.norm(x - ball.center, axis=-1) > ball.contact_radius(cloth)
        # Those on their way out stay where they are.
        hits = outside & (np.abs(x_gpu - end).max(axis=-1) > 1e-3)
        assert hits.sum() > 500
        # With friction a point travels on from the surface for the rest of the step.
        assert (distance - ball.contact_radius(cloth))[hits].min() > -4 * eps * ball.radius


def test_a_layer_has_the_bits_of_the_core(exact):
    ball = cs.Sphere((0.5, -0.29, 0.5), 0.25, cs.Linear((0.1, 0.5, 0.0)), friction=0.3)
    scene = cs.Scene(cs.Cloth((20, 20)), (ball, cs.Plane((0.0, -0.2, 0.0))))
    gpu, cpu = (cs.Stepper(scene, t=0.0, **SINGLE, backend=backend) for backend in ("gpu", "cpu"))
    for stepper in (gpu, cpu):
        stepper.advance(400, 4e-4)
    assert np.abs(gpu.positions - cpu.positions).max() <= (0 if exact else 1e-5)
    assert cs.energy(scene, gpu.positions, gpu.velocities, gpu.time)["contact"] > 0
