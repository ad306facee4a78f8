"""Steps without a contact pass, while a plane separates the cloth from every sphere
(cpp/contact/separating_planes.hpp).

How long it will is guessed from the speeds of the points. Here the guess is wrong: a dent that is
drawn upwards is let go at rest, and springs fling it through the plane, on to the sphere, within
the steps for which it was thought to be clear.
"""

import clothsim as cs
import numpy as np
import pytest
from variants import NAMED_KERNELS, pairs

DT, STEPS = 5e-4, 38
SPHERE = cs.Sphere((0.5, -0.6, 0.5), 0.5, None, "continuous", "none", restitution=0.5)
# In the cloth's box, beside the cloth: no plane across an axis is between the two, so that nothing
# is guarded.
UNGUARDED = cs.Sphere((0.1, 0.1, 0.1), 1e-3, None, "continuous", "none", restitution=1.0)


def drawn(sphere=SPHERE, columns=20):
    """A sheet, pinned around a dent that is drawn upwards, and its scene."""
    pins = np.ones((24, columns), dtype=bool)
    pins[7:17, columns // 2 - 4 : columns // 2 + 4] = False
    return let_go(
        cs.Cloth((24, columns), mass=20.0, stiffness=300.0, damping=0.0, pins=pins), sphere
    )


def let_go(cloth, sphere=SPHERE):
    """The cloth at rest, drawn upwards where it is not pinned."""
    x = cloth.rest_positions.copy()
    x[~cloth.pinned, 1] = 0.5
    return cs.Scene(cloth, sphere, gravity=(0, 0, 0)), x, np.zeros_like(x)


def unguarded(scene):
    return scene.replace(spheres=(*scene.spheres, UNGUARDED))


def test_the_reference_sees_the_same_contacts(variant):
    scene, x, v = drawn()
    expected = cs.reference_step(scene, x, v, DT, STEPS, t=0.0)
    free = cs.reference_step(scene.replace(spheres=()), x, v, DT, STEPS)
    assert 20 < (np.abs(expected[1] - free[1]).max(axis=-1) > 0.5).sum() < 300
    result = cs.step(scene, x, v, DT, STEPS, **variant.options)
    explained = (
        np.abs(cs.acceleration(scene, x, v)).max() * DT**2
    )  # as far as paths bend within a step: 5 mm
    np.testing.assert_allclose(result[0], expected[0], rtol=0, atol=explained)
    tested = cs.step(unguarded(scene), x, v, DT, STEPS, **variant.options)
    bound = {"double": 1e-9, "single": 2e-3}[variant.precision]
    np.testing.assert_allclose(result[0], tested[0], rtol=0, atol=bound)


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pairs(integrator=cs.integrators(), kernel=NAMED_KERNELS, threads=[1, 3], offset=["none", "cell"])
def test_guarded_steps_end_where_others_do(integrator, kernel, threads, offset):
    scene, x, v = drawn(SPHERE.replace(offset=offset))
    options = {"integrator": integrator, "kernel": kernel, "threads": threads}
    result = cs.step(scene, x, v, DT, STEPS, **options)
    expected = cs.step(unguarded(scene), x, v, DT, STEPS, **options)
    free = cs.step(scene.replace(spheres=()), x, v, DT, STEPS, **options)
    assert np.abs(expected[0] - free[0]).max() > 0.05
    np.testing.assert_allclose(result[0], expected[0], rtol=0, atol=1e-9)
    assert cs.penetration(result[0], SPHERE)["points"] == 0


@pytest.mark.parametrize("columns", [20, 32])
def test_bits_do_not_depend_on_the_length_of_calls(columns, precision, same_bits):
    """A call begins its own guard; where one fails, steps of earlier calls are taken again too."""
    scene, x, v = drawn(columns=columns)
    expected = cs.step(scene, x, v, DT, STEPS, precision=precision, threads=1)
    for length in (1, 7):
        stepper = cs.Stepper(scene, x, v, precision=precision, threads=1)
        for done in range(0, STEPS, length):
            stepper.advance(min(length, STEPS - done), DT)
        assert stepper.time == pytest.approx(STEPS * DT, abs=1e-12)
        assert same_bits((stepper.positions, stepper.velocities), expected)


def test_another_time_step_begins_another_guard(same_bits):
    scene, x, v = drawn()
    stepper = cs.Stepper(scene, x, v, threads=1)
    stepper.advance(5, DT / 8)
    stepper.advance(STEPS, DT)
    expected = cs.step(scene, *cs.step(scene, x, v, DT / 8, 5), DT, STEPS, t=5 * DT / 8)
    assert same_bits((stepper.positions, stepper.velocities), expected)


@pytest.mark.parametrize(
    "motion",
    [
        cs.Linear((0, 40.0, 0)),
        cs.Keyframes(
            (0.0, 0.0175, 0.0185), ((0.44, -2, 0.37), (0.44, -2, 0.37), (0.44, -0.45, 0.37))
        ),
    ],
    ids=["linear", "keyframes"],
)
def test_a_sphere_that_moves_is_seen_coming(motion, kernel):
    """From far below to the cloth within less than 64 steps."""
    cloth = cs.Cloth((16, 16), stiffness=10.0, damping=0.0, pins=())
    scene = cs.Scene(
        cloth, SPHERE.replace(center=(0.44, -1.2, 0.37), motion=motion), gravity=(0, 0, 0)
    )
    x, v = cloth.rest_positions, np.zeros((16, 16, 3))
    expected = cs.reference_step(scene, x, v, DT, STEPS, t=0.0)
    assert (np.abs(expected[0][..., 1]) > 0.02).sum() > 20
    result = cs.step(scene, x, v, DT, STEPS, t=0.0, kernel=kernel)
    np.testing.assert_allclose(
        result[0], expected[0], rtol=0, atol=1e-7
    )  # bounces magnify rounding


@pairs(axis=[0, 1, 2], side=[-1, 1], response=["ray", "continuous"], precision=["double", "single"])
def test_a_sphere_is_seen_coming_from_every_side(axis, side, response, precision):
    toward = -side * np.eye(3)[axis]
    sphere = cs.Sphere(
        (0.5, 0.0, 0.5) - 0.9 * toward,
        0.2,
        cs.Linear(100.0 * toward),
        response,
        "none",
        restitution=0.5,
    )
    cloth = cs.Cloth((16, 12), stiffness=10.0, damping=0.0, pins=())
    scene, x, v = (
        cs.Scene(cloth, sphere, gravity=(0, 0, 0)),
        cloth.rest_positions,
        np.zeros((16, 12, 3)),
    )
    steps = 45 if axis == 1 else 15  # into the contact, before it magnifies rounding
    expected = cs.reference_step(scene, x, v, 2e-4, steps, t=0.0)
    assert (np.abs(expected[1]).max(axis=-1) > 10).sum() > 2
    result = cs.step(scene, x, v, 2e-4, steps, t=0.0, precision=precision)
    np.testing.assert_allclose(
        result[0], expected[0], rtol=0, atol={"double": 1e-7, "single": 2e-3}[precision]
    )
