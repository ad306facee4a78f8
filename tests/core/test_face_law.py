"""The law of contact of offset "face": impulses for what arrives, Coulomb's cone for what rests.

`clothsim contact` measures the figures at more steps, radii and counts.
"""

import clothsim as cs
import numpy as np
import pytest
from clothsim.lab.contact import face_drop, impact, lying, shots, squeezes, stick

STEPS = (1e-4, 2e-5, 5e-6)


@pytest.mark.parametrize(
    ("speed", "precision"), [(1e-3, "double"), (1.0, "double"), (300.0, "double"), (1.0, "single"), (300.0, "single")]
)
@pytest.mark.parametrize("dt", [1e-4, 1e-6])
def test_an_elastic_impact_keeps_the_energy(dt, speed, precision):
    """In single at 1 mm/s the rounding of the springs alone is 1e-8 of it."""
    assert impact(speed, dt, phases=10, precision=precision)["worst"] < 1e-9


@pytest.mark.parametrize(("speed", "dt"), [(1e-3, 1e-6), (1.0, 1e-4), (300.0, 2e-5)])
def test_an_impact_takes_what_the_restitution_says(speed, dt):
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


def test_no_shot_passes():
    result = shots(120, seed=3)
    assert result["hits"] > 40 and result["passed"] == 0


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
