"""A large state is copied and looked at by several threads, each with its share of the rows."""

import clothsim as cs
import numpy as np
import pytest
from tables import each

SHAPE = (330, 320)  # more than 100,000 mass points


@pytest.fixture(scope="module")
def state():
    rng = np.random.default_rng(3)
    cloth = cs.Cloth(SHAPE, (33.0, 32.0), mass=0.5 * SHAPE[0] * SHAPE[1], pins=())
    x = cloth.rest_positions + 1e-3 * rng.normal(size=(*SHAPE, 3))
    return cs.Scene(cloth), x, 0.1 * rng.normal(size=(*SHAPE, 3))


@each("row", [0, 164, 165, 219, 220, 329])
def test_a_point_that_is_lost_is_found_and_the_state_before_is_back(kernel, state, row):
    """Wherever it is: an infinite speed next to the borders between shares."""
    scene, x, v = state
    v = v.copy()
    v[row, 7, 1] = 1e160  # its square is no number
    stepper = cs.Stepper(scene, x, v, kernel=kernel, threads=2)
    with pytest.raises(cs.UnstableError) as raised:
        stepper.advance(3, 1e-5)
    # A step carries news by two rows and columns with each of its four evaluations.
    assert abs(raised.value.point[0] - row) <= 8
    assert abs(raised.value.point[1] - 7) <= 8
    assert raised.value.step == 1
    np.testing.assert_array_equal(raised.value.x, x)
    np.testing.assert_array_equal(stepper.positions, x)
