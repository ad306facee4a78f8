"""Spheres that a caller moves, a call at a time."""

import clothsim as cs
import numpy as np
import pytest

PLACE, VELOCITY = np.array([0.25, -0.25, 0.25]), np.array([0.3, 1.5, -0.2])
STEPS = 20
DT = 5e-4


def scene_of(response):
    cloth = cs.Cloth(
        (9, 9), (0.5, 0.5), mass=0.2, stiffness=60.0, damping=0.01, pins=[(0, 0), (-1, 0)]
    )
    return cs.Scene(
        cloth, cs.Sphere(tuple(PLACE), 0.2, response=response, offset="edge", friction=0.3)
    )


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("response", ["ray", "reflect"])
def test_a_frame_per_call_is_the_motion_of_one_run(response, kernel):
    scene = scene_of(response)
    by_hand = cs.Stepper(scene, kernel=kernel)
    jumps = cs.Stepper(scene, kernel=kernel)
    moving = cs.Stepper(
        scene.replace(spheres=scene.spheres[0].replace(motion=cs.Linear(VELOCITY))), kernel=kernel
    )
    for frame in range(1, 13):
        center = PLACE + frame * STEPS * DT * VELOCITY
        by_hand.advance(STEPS, DT, centers={0: center})
        jumps.set_scene(scene.replace(spheres=scene.spheres[0].replace(center=tuple(center))))
        for stepper in (jumps, moving):
            stepper.advance(STEPS, DT)
        assert np.abs(by_hand.positions - moving.positions).max() < 1e-9
    assert np.abs(by_hand.positions - jumps.positions).max() > 1e-4
    assert by_hand.positions[4, 4, 1] > 0.02  # the sheet is lifted
    assert by_hand.scene == scene.replace(spheres=scene.spheres[0].replace(center=tuple(center)))


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
def test_a_step_that_fails_leaves_the_sphere_on_its_way():
    cloth = cs.Cloth((5, 5), mass=1.0, stiffness=5e4, damping=0.0)
    stepper = cs.Stepper(
        cs.Scene(cloth, cs.Sphere((0, -9, 0), 0.1)),
        *(cs.Cloth((5, 5)).rest_positions * s for s in (1.01, 0)),
    )
    with pytest.warns(cs.StabilityWarning), pytest.raises(cs.UnstableError):
        stepper.advance(4000, 0.02, centers={0: (0, -8, 0)})
    assert stepper.scene.spheres[0].center == pytest.approx((0, -9 + stepper.time / 80, 0))
