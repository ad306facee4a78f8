"""Energy that a step makes of nothing: below the guaranteed step too, at states it leaves out."""

import warnings

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core

BLOCK = _core.heuristics["steps_of_block"]
SHEET = cs.Cloth((8, 8), mass=32.0, stiffness=35_000.0, damping=0.0)


def random_positions(seed, scale=1.0):
    """Put every free point anywhere in a box as large as `scale` sheets."""
    x = np.random.default_rng(seed).uniform(0.0, scale, (8, 8, 3))
    x[SHEET.pinned] = SHEET.rest_positions[SHEET.pinned]
    return cs.Scene(SHEET, position=x)


def random_velocities(seed, speed):
    """Give every free point of the flat sheet a velocity of its own."""
    v = np.random.default_rng(seed).normal(scale=speed, size=(8, 8, 3)) * ~SHEET.pinned[..., None]
    return cs.Scene(SHEET, velocity=v)


def run(scene, integrator, steps=2000, part=1.0, **options):
    """Run at a part of the guaranteed step: return the report, or the error, and the warnings."""
    dt = part * cs.max_stable_dt(scene, integrator)
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        try:
            report = cs.simulate(scene, steps * dt, dt, integrator, threads=1, **options).report
        except cs.UnstableError as error:
            return error, record
    return report, record


def energy_of(scene, x, v):
    parts = cs.energy(scene, x, v)
    return parts["total"], parts["kinetic"] + parts["elastic"]


SYMPLECTIC = ("velocity_verlet", "semi_implicit_euler", "pefrl")


@pytest.mark.parametrize(("seed", "integrator"), list(enumerate([*SYMPLECTIC, "dop853"])))
def test_energy_that_grows_at_the_guaranteed_step_ends_the_run(integrator, seed):
    """The error comes at the first step by which nine tenths are made.

    A warning precedes it, with a step at which the state is stable, if growth took more than a
    block of steps.
    """
    for scene in (
        random_positions(seed),
        random_positions(seed, 0.3),
        random_velocities(seed, 100.0),
    ):
        error, record = run(scene, integrator)
        assert isinstance(error, cs.UnstableError) and error.dt <= error.max_stable_dt
        start, _ = energy_of(scene, scene.initial_position, scene.initial_velocity)
        last, moving = energy_of(scene, error.x, error.v)
        assert last - start <= 0.9 * moving
        x, v = cs.step(scene, error.x, error.v, error.dt, integrator=integrator)
        total, moving = energy_of(scene, x, v)
        assert total - start > 0.9 * moving
        for warning in record:
            assert warning.category is cs.StabilityWarning and "out of nothing" in str(
                warning.message
            )
        assert len(record) == 1 or error.step <= 2 * BLOCK


@pytest.mark.parametrize("integrator", [*SYMPLECTIC, "rk4", "dopri5"])
def test_energy_that_swings_is_no_growth(integrator):
    """Energies of symplectic methods swing most at the guaranteed step."""
    x = SHEET.rest_positions.copy()
    x[..., 0] *= 0.8  # The sheet is compressed, and buckles.
    x[..., 1] = 1e-3 * np.random.default_rng(0).normal(size=(8, 8)) * ~SHEET.pinned
    buckling = cs.Scene(SHEET.replace(pins=()), position=x)
    for scene in (
        cs.Scene(SHEET),
        random_velocities(0, 1.0),
        random_velocities(1, 10.0),
        random_velocities(2, 3.0),
        buckling,
    ):
        report, record = run(scene, integrator, 1500)
        assert not record and isinstance(report, dict)
        assert report["energy"]["gained"] >= 0 and report["energy"]["reason"] == ""


def test_the_energy_gained_is_the_largest_of_the_watched_states():
    scene = random_velocities(0, 1.0)
    dt = cs.max_stable_dt(scene, "velocity_verlet")
    gains = []
    stepper = cs.Stepper(scene, integrator="velocity_verlet", threads=1)
    start, _ = energy_of(scene, stepper.positions, stepper.velocities)
    for _ in range(10):
        stepper.advance(BLOCK, dt)
        gains.append(energy_of(scene, stepper.positions, stepper.velocities)[0] - start)
    for threads in (1, 2):
        run = cs.simulate(scene, 10 * BLOCK * dt, dt, "velocity_verlet", threads=threads)
        assert (
            run.report["energy"]["gained"] == pytest.approx(max(gains), rel=1e-12)
            and max(gains) > 1
        )
    swept = cs.sweep(
        scene,
        duration=10 * BLOCK * dt,
        dt=dt,
        integrator="velocity_verlet",
        metrics="energy_gained",
        progress=False,
    )
    assert float(swept.energy_gained) == run.report["energy"]["gained"]
    damped = cs.simulate(cs.scenes.paper_swing(), 0.2, 1e-3).report["energy"]
    assert damped["gained"] == 0.0 and damped["reason"] == ""
    adaptive = cs.simulate(random_velocities(0, 1.0), 0.3, rtol=1e-9, integrator="dop853").report[
        "energy"
    ]
    assert 0 <= adaptive["gained"] < 1e-6 * start


def test_a_batch_is_judged_member_by_member():
    wild = random_positions(1)
    calm = random_velocities(1, 1.0)
    dt = cs.max_stable_dt(wild, "velocity_verlet")
    single = cs.Stepper(calm, integrator="velocity_verlet", threads=1)
    single.advance(1000, dt)
    batch = cs.Stepper([calm, wild], integrator="velocity_verlet", threads=1)
    with (
        pytest.warns(cs.StabilityWarning, match="member 1"),
        pytest.raises(cs.UnstableError) as raised,
    ):
        batch.advance(1000, dt)
    assert raised.value.member == 1
    batch.freeze(1)
    batch.advance(1001 - raised.value.step, dt)
    assert (batch.positions[0] == single.positions).all()
    gained = [stepper._state.core.watched[0]["energy_gained"] for stepper in (batch, single)]
    assert gained[0] == gained[1] > 0


def test_a_cloth_that_falls_as_one_body_is_stable_at_any_speed(precision):
    """Points cross more than the sheet within a step, but not relative to each other."""
    cloth = cs.Cloth((8, 8), mass=1.0, stiffness=10.0, damping=0.0, pins=())
    velocity = np.broadcast_to([0.0, -300.0, 0.0], (8, 8, 3))
    scene = cs.Scene(cloth, gravity=(0, 0, 0), velocity=velocity)
    dt = 1.2 * cs.max_stable_dt(scene)
    assert 300 * dt > 5
    stepper = cs.Stepper(scene, precision=precision)
    with pytest.warns(cs.StabilityWarning, match="is above"):
        stepper.advance(1000, dt)
    assert abs(stepper.velocities - velocity).max() < 1e-3


@pytest.mark.parametrize("response", ["ray", "reflect"])
def test_a_response_ends_the_watch(response):
    """A response may add energy: a point bounces with four times its speed of arrival."""
    sphere = cs.Sphere((0.5, -0.35, 0.5), 0.3, response=response, offset="none")
    object.__setattr__(sphere, "restitution", 4.0)  # No public sphere does that.
    cloth = cs.Cloth((8, 8), mass=1.0, stiffness=100.0, damping=0.0, pins=())
    scene = cs.Scene(cloth, sphere, velocity=np.zeros((8, 8, 3)) + (0, -1.0, 0))
    energy = cs.simulate(scene, 0.4, 2e-4).report["energy"]
    assert np.isnan(energy["gained"]) and "responded" in energy["reason"]
    stepper = cs.Stepper(scene)
    stepper.advance(2000, 2e-4)
    start, _ = energy_of(scene, scene.initial_position, scene.initial_velocity)
    total, moving = energy_of(scene, stepper.positions, stepper.velocities)
    assert total - start > 0.9 * moving
