"""The ready scenes: Table 2 of Kim et al., and the two with a known solution."""

import json

import numpy as np
import pytest
from clothsim.model import ready as scenes
from clothsim.model.scene import Scene

PAPER = [scenes.paper_static, scenes.paper_moving, scenes.paper_swing]


@pytest.mark.parametrize("make", PAPER)
def test_paper_scenes_take_table_2(make):
    scene = make()
    cloth = scene.cloth
    assert (cloth.shape, cloth.size, cloth.mass) == ((32, 32), (1.0, 1.0), 512.0)
    assert (cloth.stiffness, cloth.damping, cloth.drag) == (35_000.0, 100.0, 0.0)
    assert scene.gravity == (0.0, -9.80665, 0.0)
    assert (cloth.spring_count(), make(bend=True).cloth.spring_count()) == (3906, 5826)
    assert np.argwhere(cloth.pinned).tolist() == [[0, 0], [31, 0]]
    assert (scene.initial_position[..., 1] == 0).all() and not scene.initial_velocity.any()
    assert Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    with pytest.raises(TypeError, match="bend must be True or False"):
        make(bend="yes")


def test_paper_static_sphere():
    (sphere,) = scenes.paper_static().spheres
    assert (sphere.center, sphere.radius, sphere.motion) == ((0.5, -0.5, 0.5), 0.25, None)
    assert (sphere.response, sphere.offset, sphere.as_printed) == ("ray", "edge", False)
    (sphere,) = scenes.paper_static("reflect", offset="none", as_printed=True).spheres
    assert (sphere.response, sphere.offset, sphere.as_printed) == ("reflect", "none", True)


@pytest.mark.parametrize("make", [scenes.paper_static, scenes.paper_moving])
def test_paper_scenes_take_every_response(make):
    """The restitution is 1 for each response that has one."""
    for response, restitution in {"ray": 1, "reflect": 1, "penalty": None}.items():
        (sphere,) = make(response).spheres
        assert (sphere.response, sphere.restitution) == (response, restitution)
        assert (sphere.center[1:], sphere.thickness) == ((-0.5, 0.5), None)


def test_paper_moving_sphere_travels_one_metre_about_the_hanging_cloth():
    scene = scenes.paper_moving("reflect", offset=0.01, as_printed=True, phase=0.0)
    (sphere,) = scene.spheres
    assert (sphere.response, sphere.offset, sphere.as_printed) == ("reflect", 0.01, True)
    path = sphere.center_at(np.linspace(0.0, 4.2, 10_001))
    assert (path[:, 1] == -0.5).all() and (path[:, 2] == 0.5).all()
    assert path[0].tolist() == [-0.5, -0.5, 0.5]
    assert np.ptp(path[:, 0]) == pytest.approx(1.0, abs=1e-12)
    # No point of the level cloth is inside at the start, from either side.
    for phase in (0.0, 0.5):
        (start,) = scenes.paper_moving(phase=phase).spheres
        gap = scene.initial_position - start.center_at(0.0)
        assert np.linalg.norm(gap, axis=-1).min() > start.contact_radius(scene.cloth)
    assert scenes.paper_moving(period=2.0).spheres[0].motion.period == 2.0


@pytest.mark.parametrize("shape", [(16, 16), (16, 1), (2, 3)])
def test_hanging_rests_at_the_documented_solution(shape, oracle):
    """Every spring carries the weight below it."""
    scene = scenes.hanging(shape)
    rows = shape[0]
    row = np.arange(shape[0])
    sag = scene.cloth.mass_per_point[0, 0] * 9.80665 / 1_000.0
    x = scene.initial_position.copy()
    x[..., 1] = (-row / (rows - 1) - sag * row * (2 * rows - row - 1) / 2)[:, None]
    a = oracle.acceleration(scene, x, np.zeros_like(x))
    # Rounding of a length (1e-16 m) times stiffness over mass (1e5 / s^2).
    assert np.abs(a).max() < 1e-9
    assert scene.cloth.pinned[0].all() and not scene.cloth.pinned[1:].any()
    assert (scene.initial_position[..., 2] == 0).all()
