"""A plank that rocks on a cylinder: a chain of one link on a sphere with offset "face".

The plank rolls. Tilted by the angle q, its middle is at the height R cos q + R q sin q above the centre. It moves at
the speed R q w. With I = m L^2/4 of two mass points,

    E = (I + m R^2 q^2) w^2/2 + m g R (cos q + q sin q - 1)

so small swings have the angular frequency sqrt(4 g R)/L. The link touches at its middle, and at another place as it tilts.
"""

import math

import clothsim as cs
import numpy as np
import pytest

RADIUS, LENGTH, MASS, GRAVITY = 0.25, 0.1, 0.04, 9.81
FREQUENCY = math.sqrt(4 * GRAVITY * RADIUS) / LENGTH


def rocking(dt, duration, precision="double", turn=0.2):
    """Angles, and changes of energy over the kinetic energy of the start, after every 20 steps."""
    cloth = cs.Cloth((1, 2), (1.0, LENGTH), MASS, 2000.0, 0.0, pins=())
    sphere = cs.Sphere((0, -RADIUS, 0), RADIUS, None, "continuous", "face", 0.0, 1.0)
    x = cloth.rest_positions - cloth.rest_positions.mean(axis=(0, 1)) + (0.0, RADIUS * 5e-7, 0.0)
    v = np.zeros_like(x)
    v[..., 1] = turn * (x[..., 0] + x[..., 2])
    scene = cs.Scene(cloth, sphere, position=x, velocity=v)
    stepper = cs.Stepper(scene, threads=1, precision=precision)
    first = cs.energy(scene, x, v)
    angles, energies = [], []
    for _ in range(round(duration / dt / 20)):
        stepper.advance(20, dt)
        along = stepper.positions[0, 1] - stepper.positions[0, 0]
        angles.append(math.atan2(along[1], math.hypot(along[0], along[2])))
        energies.append(
            (cs.energy(scene, stepper.positions, stepper.velocities)["total"] - first["total"]) / first["kinetic"]
        )
    return np.array(angles), np.array(energies)


@pytest.mark.parametrize(
    ("dt", "precision", "bound"), [(1e-3, "double", 1e-5), (1e-4, "double", 1e-6), (1e-4, "single", 1e-4)]
)
def test_its_energy_neither_grows_nor_falls(dt, precision, bound):
    """The explicit place of contact drives it: 0.1 in 2 s at 1e-4 s. Where the step ends, the place takes as much."""
    _, energies = rocking(dt, 2.0, precision)
    half = len(energies) // 2
    assert abs(energies[half:].mean() - energies[:half].mean()) < bound


def test_it_rocks_at_its_frequency():
    angles, _ = rocking(1e-4, 1.0, turn=0.1)
    (crossings,) = np.nonzero((angles[:-1] < 0) & (angles[1:] >= 0))
    assert len(crossings) == 4 or len(crossings) == 5
    parts = angles[crossings] / (angles[crossings] - angles[crossings + 1])
    times = 20e-4 * (crossings + 1 + parts)
    period = np.diff(times).mean()
    assert period == pytest.approx(2 * math.pi / FREQUENCY, rel=2e-3)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_sheet_that_turns_under_a_sphere_gains_no_energy(friction):
    """The place of contact moves within a step. An impulse on the mean of its weights makes 6e-6 of the energy a step."""
    largest = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = int(rng.integers(2, 5))
        cloth = cs.Cloth((points, points), mass=0.1 * points**2, stiffness=1.0, damping=0.0, pins=())
        x = cloth.rest_positions - (0.5, 0.0, 0.5)
        spin = np.array([rng.normal(), 0, rng.normal()]) * 50
        x += np.insert(rng.uniform(-0.3, 0.3, 2), 1, 0.0)
        v = np.cross(spin, x) - (0, 50, 0)
        sphere = cs.Sphere((0, -0.5, 0), 0.4, None, "continuous", "face", 0.0, friction)
        stepper = cs.Stepper(cs.Scene(cloth, sphere, (0, 0, 0), position=x, velocity=v), threads=1)
        energies = [cs.energy(stepper.scene, x, v)["total"]]
        for _ in range(300):
            stepper.advance(1, 1e-4)
            energies.append(cs.energy(stepper.scene, stepper.positions, stepper.velocities)["total"])
        assert energies[-1] < 0.999 * energies[0]  # it was hit
        largest.append(np.diff(energies).max() / energies[0])
    assert max(largest) < 3e-7
