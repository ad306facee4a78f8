"""The gather kernel takes a thread's groups of one group row as one tile.

With as many threads as groups each takes its group alone: the oracle for every bit.
"""

import clothsim as cs
import numpy as np
from variants import PRECISIONS, pairs

# 3 x 5 groups, 1 x 63, 63 x 1 and 8 x 20, which alone are all whole.
SHAPES = [(33, 70), (9, 1003), (1003, 9), (128, 320)]
# Under the middle of the cloth, and around a corner.
BALLS = (
    cs.Sphere((0.45, -9.95, 0.65), 10.0, friction=0.1, response="ray", offset="edge"),
    cs.Sphere((0.0, 0.0, 0.0), 0.2, response="ray", offset="edge"),
)


def stepped(scene, x, v, dt, calls, **options):
    stepper = cs.Stepper(scene, x, v, kernel="gather", **options)
    for steps in calls:
        stepper.advance(steps, dt)
    a = np.empty((1, *x.shape))
    stepper._state.core.accelerations(a, options["threads"])
    return stepper.positions, stepper.velocities, a, np.array(stepper._state.core.contacts)


@pairs(precision=PRECISIONS, shape=SHAPES, mass=["uniform", "per point"])
def test_tiles_give_the_bits_of_groups(precision, crumpled, same_bits, shape, mass):
    """However many groups a tile has, also where a share ends within a row of groups."""
    state = crumpled(shape=shape, mass=mass, spheres=BALLS)
    options = {"precision": precision}
    groups = -(-shape[0] // 16) * -(-shape[1] // 16)
    expected = stepped(*state, [4], threads=groups, **options)
    assert np.abs(expected[2]).max() > 1
    assert expected[3][0] > 100
    for threads, calls in [(1, [4]), (2, [1, 2, 1]), (3, [3, 1]), (5, [4]), (7, [1, 3])]:
        assert same_bits(stepped(*state, calls, threads=threads, **options), expected), threads
