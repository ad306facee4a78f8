"""The law of contact of offset "face": impulses for what arrives, Coulomb's cone for what rests.

`python benchmarks/contact` measures the figures at more steps, radii and counts.
"""

import clothsim as cs
import numpy as np
import pytest
from contact import draped, face_drop, impact, lying, stick
from contact.physics import on_sphere
from contact_fuzz import rests, shots, squeezes
from contact_fuzz.search import finds_place
from contact_fuzz.shots import _passed

STEPS = (1e-4, 2e-5, 5e-6)


@pytest.mark.parametrize(
    ("speed", "precision"), [(1e-3, "double"), (1.0, "double"), (300.0, "double"), (1.0, "single"), (300.0, "single")]
)
@pytest.mark.parametrize("dt", [1e-4, 1e-6])
def test_an_elastic_impact_keeps_the_energy(dt, speed, precision):
    """In single at 1 mm/s the rounding of the springs alone is 1e-8 of it."""
    assert impact(speed, dt, phases=10, precision=precision)["worst"] < 1e-9


@pytest.mark.parametrize(("speed", "dt"), [(1e-3, 1e-6), (1.0, 1e-4), (300.0, 2e-5)])
def test_an_impact_loses_the_energy_of_its_restitution(speed, dt):
    assert impact(speed, dt, 0.5, phases=10)["worst"] < 1e-9


@pytest.mark.parametrize("dt", STEPS[:2])
def test_a_cell_stays_above_the_tangent_of_the_slope(dt):
    assert stick(1.05, dt)["slip"] < 1e-6


@pytest.mark.parametrize("radius", [0.25, 10.0])
def test_a_cell_slides_below_it_as_the_formula_says(radius):
    result = stick(0.95, radius=radius)
    assert result["slip"] == pytest.approx(result["expected"], rel=0.02)


@pytest.mark.parametrize(("dt", "bound"), [(1e-4, 1e-4), (5e-6, 1e-6)])
def test_a_bouncing_sheet_keeps_its_energy(dt, bound):
    result = face_drop(dt)
    assert result["gained"] < bound and result["lost"] < bound


def test_impacts_within_a_step_lose_as_much_as_in_small_steps():
    """The cell at 300 m/s tilts and hits the sphere three times in 1e-4 s, as 1,000 small steps show."""
    cloth = cs.Cloth((2, 2), (0.1, 0.1), 0.04, 1e-9, 0.0, pins=())
    sphere = cs.Sphere((0, -0.25, 0), 0.25, None, "continuous", "face", 0.5)
    x = cloth.rest_positions - (0.045, -0.0015, 0.04)
    scene = cs.Scene(cloth, sphere, (0, 0, 0), x, np.broadcast_to((0.0, -300.0, 0.0), x.shape))
    parts = []
    for steps in (1, 1000):
        stepper = cs.Stepper(scene)
        stepper.advance(steps, 1e-4 / steps)
        parts.append(cs.energy(scene, stepper.positions, stepper.velocities)["kinetic"] / (0.02 * 300.0**2))
    assert parts[1] == pytest.approx(0.3316, abs=1e-3)
    assert parts[0] == pytest.approx(parts[1], abs=0.02)


def test_no_shot_passes():
    result = shots(40, seed=3)
    assert result["hits"] > 20 and result["passed"] == 0


def test_moves_by_a_search_reach_the_state():
    """The search for a place drops the contacts of its earlier rounds, but not where they moved points."""
    assert shots(6, seed=204)["passed"] == 0


def test_the_independent_search_finds_a_place_only_where_there_is_one(closing):
    """The spheres leave a gap until 0.025 s and overlap after it."""
    scene = closing((3, 3))
    x = scene.initial_position
    found = [finds_place(scene, x, 0.0, end, _passed) for end in (0.02, 0.035)]
    assert found == [True, False]


def test_spheres_that_leave_a_gap_leave_a_place():
    result = squeezes(20, seed=6)
    assert result["refused"] == 0 and result["inside"] == 0


def test_a_snapshot_of_a_sheet_in_contact_goes_on_bit_for_bit(same_bits):
    """The impulses of what rests, with which the next step begins, are part of it."""
    sphere = cs.Sphere((0.5, -0.26, 0.5), 0.25, None, "continuous", "face", 0.0, 0.3)
    stepper = cs.Stepper(cs.Scene(cs.Cloth((6, 6), mass=1.0, stiffness=200.0, damping=0.5, pins=()), sphere))
    stepper.advance(800, 1e-4)
    other = cs.Stepper.restore(stepper.snapshot())
    for each in (stepper, other):
        each.advance(50, 1e-4)
    assert same_bits((stepper.positions, stepper.velocities), (other.positions, other.velocities))
    # A corner of a cell that lies on the sphere.
    assert np.linalg.norm(stepper.positions - np.array(sphere.center), axis=-1).min() < 0.268


def test_a_sheet_lies_quietly():
    """Where velocities do not start from all impulses of the step before, 7e-6 m/s remain."""
    found = lying(steps=500)
    assert found["depth"] == 0 and found["speed"] < 1e-6


def test_a_sheet_stays_above_the_tangent_of_the_slope():
    """Its triangles rock a little. Contact at their places where the step begins lets the sheet creep by 4e-6 m."""
    assert stick(1.05, radius=10.0, points=12, duration=0.02)["slip"] < 1e-7


def test_a_draped_sheet_comes_to_rest():
    found = draped(points=10, dt=1e-4, duration=3.0)
    assert found["depth"] == 0 and found["speed"] < 1e-6


def test_random_sheets_come_to_rest():
    found = rests(2, seed=5)
    assert found["quiet"] == 2 and found["depth"] == 0


@pytest.mark.parametrize("restitution", [0.01, 0.5])
def test_a_cell_that_bounces_comes_to_rest_too(restitution):
    """The energy that a bounce restores is that of what arrives, not of what rests."""
    cloth = cs.Cloth((2, 2), (0.12, 0.12), 2.4e-3, 1766.0, 0.0, 0.012, pins=())
    sphere = cs.Sphere((0, -0.31, 0), 0.31, None, "continuous", "face", restitution, 5.0)
    x = on_sphere(cloth, sphere.center, sphere.contact_radius(cloth), 0.0)
    stepper = cs.Stepper(cs.Scene(cloth, sphere, position=x), threads=1)
    stepper.advance(15_000, 1e-4)
    # Of what gravity gives in a step. With restitution 0.5 a tenth (AVX2) to a fifth (SSE2) remains.
    assert np.abs(stepper.velocities).max() < 9.8 * 1e-4 / 4
