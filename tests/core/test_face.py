"""Offset "face": no triangle of the cloth dips into the sphere, however small and fast it is."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import clothsim as cs
import contact_fuzz
import numpy as np
import pytest
from clothsim.paper.side_by_side import follow
from contact_fuzz import triangle_cases
from contact_fuzz.exact import distance, nearest_approach


def test_no_moving_triangle_is_missed():
    """`contact_fuzz triangles --full` and the slow test take 1e6."""
    result = triangle_cases(6_000)
    assert result["touching"] > 1_500
    assert result["missed"] == 0


def test_the_fuzzers_have_a_command():
    command = [sys.executable, str(Path(contact_fuzz.__file__).parent), "triangles", "--count", "100", "--seed", "5"]
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    result = json.loads(out)
    assert result["cases"] > 1000 and result["touching"] > 300 and result["missed"] == 0


@pytest.mark.slow
def test_no_moving_triangle_of_1e6_is_missed():
    result = triangle_cases(10**6, seed=2)
    assert result["touching"] > 3e5 and result["missed"] == 0


def test_the_exact_check_agrees_with_sampling():
    """The independent check is itself checked: against 4,000 looks at each of 40 triangles."""
    rng = np.random.default_rng(3)
    p0 = rng.normal(size=(40, 3, 3)) + np.array((0, 0, 2.0))
    p1 = rng.normal(size=(40, 3, 3)) - np.array((0, 0, 2.0))
    t = np.linspace(0, 1, 4_000)[:, None, None]
    for radius in (0.05, 0.5):
        exact = nearest_approach(p0, p1, radius)
        for k in range(40):
            sampled = distance(p0[k] + t * (p1[k] - p0[k])).min()
            assert (exact[k] < radius) == (sampled < radius) or abs(sampled - radius) < 2e-3


@pytest.mark.parametrize("scene, end, dt", [("static", 0.3, 2e-4), ("moving", 0.32, 2e-4), ("fast", None, 1e-4)])
def test_no_triangle_dips_in_the_papers_scenes_and_at_100_m_per_s(scene, end, dt):
    """Every step is looked at; the whole scenes are in `python benchmarks/contact`."""
    row = follow(scene, "continuous, face", end, 1, dt)
    assert row["failure"] is None
    assert row["points"] == 0 and row["triangles"] == 0 and row["crossings"] == 0
    assert abs(row["energy_gained"]) > 0


@pytest.mark.parametrize("response", ["reflect, corrected", "ray, corrected", "continuous"])
def test_the_others_do_dip(response):
    """The check can fail: mass points alone leave triangles half a millimetre in."""
    row = follow("static", response, 0.3, 8, 2e-4)
    assert row["triangles"] > 2e-4


@pytest.mark.parametrize("radius", [0.002, 0.01, 0.04])
@pytest.mark.parametrize("speed", [3.0, 300.0])
def test_a_sphere_smaller_than_a_cell_is_caught(kernel, radius, speed):
    """Through the middle of a triangle, with no mass point near: only the triangle sees it."""
    cloth = cs.Cloth((8, 8), mass=2.0, stiffness=2000.0, damping=1.0, pins=())
    cell = cloth.spacing[0]
    start = np.array((3.3 * cell, -radius - 0.01, 3.25 * cell))
    motion = cs.Linear((0, speed, 0))
    dt = 1e-4
    steps = round(0.15 / speed / dt) or 1
    steps = max(steps, 3)
    for offset, caught in (("face", True), ("none", False)):
        sphere = cs.Sphere(start, radius, motion, "continuous", offset, restitution=0.3)
        stepper = cs.Stepper(cs.Scene(cloth, sphere), kernel=kernel)
        for _ in range(steps):
            stepper.advance(1, dt)
            if caught:
                assert cs.penetration(stepper.positions, sphere, stepper.time)["triangles"] == 0
        top = sphere.center_at(stepper.time)[1]
        hit = np.abs(stepper.velocities[..., 1]).max() > 0.2 * speed
        assert hit == caught
        if caught:
            near = stepper.positions[3:5, 3:5, 1].max()
            assert near > min(top, 0.01)


def test_a_stretched_triangle_is_kept_out_as_it_is_now():
    """Twice the size of the cloth at rest: eq 13 for the rest length is far too little."""
    cloth = cs.Cloth((9, 9), mass=1.0, stiffness=10.0, damping=0.5)
    x = 2.0 * cloth.rest_positions
    depth = {}
    for offset in ("edge", "face"):
        sphere = cs.Sphere((1.05, -0.32, 1.05), 0.3, None, "continuous", offset, restitution=0.0)
        scene = cs.Scene(cloth, sphere, position=x, velocity=np.where(cloth.pinned[..., None], 0, (0, -2.0, 0)))
        stepper = cs.Stepper(scene)
        deepest = 0.0
        for _ in range(100):
            stepper.advance(1, 1e-3)
            deepest = max(deepest, cs.penetration(stepper.positions, sphere)["triangles"])
        depth[offset] = deepest
    assert depth["face"] == 0
    assert depth["edge"] > 5e-3


def test_a_chain_is_kept_out_between_its_points():
    cloth = cs.Cloth((1, 6), (1.0, 1.0), 0.6, 500.0, 0.2, springs=("structural",), pins=((0, 0), (0, -1)))
    sphere = cs.Sphere((0.5, -0.05, 0.0), 0.03, None, "continuous", "face", restitution=0.0)
    scene = cs.Scene(cloth, sphere)
    stepper = cs.Stepper(scene)
    for _ in range(300):
        stepper.advance(1, 1e-3)
        x = stepper.positions[0]
        links = np.stack([x[:-1], x[1:], x[1:]], axis=1) - np.array(sphere.center)
        assert distance(links).min() >= sphere.radius
    assert stepper.positions[0, 2:4, 1].min() > -0.08


def test_offset_length_is_that_of_a_cells_diagonal():
    """sqrt(rho^2 + R^2) - R with rho half the diagonal: its middle just touches."""
    cloth = cs.Cloth((5, 5), size=(0.4, 0.8))
    sphere = cs.Sphere(radius=0.3, response="continuous", offset="face", restitution=1.0)
    rho = np.hypot(0.1, 0.2) / 2
    np.testing.assert_allclose(sphere.contact_radius(cloth), np.hypot(0.3, rho), rtol=1e-15)


@pytest.mark.parametrize("shape", [(3, 3), (5, 5)], ids=str)
def test_two_spheres_that_leave_no_place_are_refused(closing, shape):
    """A cloth's middle is caught between two spheres that close upon it."""
    scene = closing(shape)
    with pytest.raises(cs.ContactError) as error:
        cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-3, 60, t=0.0)
    # They meet at 0.025 s; until then the cloth has a place. In a step they close in by 4 mm.
    assert 0.0249 < error.value.time < 0.0261
    for sphere in scene.spheres:
        assert cs.penetration(error.value.x, sphere, error.value.time)["triangles"] < 4e-3


def test_a_warning_names_the_pinned_corner(diagonal_on_pins):
    """The first corner of the triangles between is free."""
    scene = diagonal_on_pins
    with pytest.warns(cs.ContactWarning, match=r"pinned mass point \(0, 1\)"):
        cs.step(scene, scene.initial_position, scene.initial_velocity, 0.01, 12, t=0.0)


def test_a_sphere_within_a_cell_gives_a_warning_at_the_start():
    """No mass point is inside, but the triangle by 60 mm: without the warning the push has no cause to see."""
    cloth = cs.Cloth((3, 3), pins=())
    sphere = cs.Sphere((0.25, -0.04, 0.25), 0.1, None, "continuous", "face")
    with pytest.warns(cs.ContactWarning, match=r"a triangle by 0.06 m"):
        cs.Stepper(cs.Scene(cloth, sphere))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper = cs.Stepper(cs.Scene(cloth, sphere.replace(center=(0.25, -0.1001, 0.25))))
        stepper.set_scene(stepper.scene)
    with pytest.warns(cs.ContactWarning, match=r"spheres\[1\] starts on the cloth: 1 mass points"):
        stepper.set_scene(stepper.scene.replace(spheres=(*stepper.scene.spheres, sphere.replace(center=(0.5, 0.0, 0.5)))))


def test_the_penetration_of_a_chain_counts_its_links():
    chain = cs.Cloth((1, 3), (1.0, 1.0), springs=("structural",), pins=()).rest_positions
    depth = cs.penetration(chain, cs.Sphere((0.25, -0.04, 0.0), 0.1))
    assert depth["points"] == 0
    np.testing.assert_allclose(depth["triangles"], 0.06, rtol=1e-12)
