"""What mechanics says without knowing the code: solutions, conserved quantities, symmetries."""

import clothsim as cs
import numpy as np
from tables import each
from variants import cases


@cases()
@each("shape", [(6, 7), (9, 20), (12, 33), (20, 32), (8, 80)])
def test_a_cloth_without_springs_falls_freely(variant, shape):
    cloth = cs.Cloth(shape, springs=(), pins=(), damping=0.0)
    scene = cs.Scene(cloth, gravity=(0.5, -9.80665, 0.25))
    x = cloth.rest_positions
    v = np.random.default_rng(0).uniform(-1, 1, x.shape)
    dt, steps = 1e-2, 20
    t, g = dt * steps, np.array(scene.gravity)
    for threads in (1, 2):
        end, w = cs.step(scene, x, v, dt, steps, **variant.options | {"threads": threads})
        rounding = 1e-14 if variant.precision == "double" else 1e-6
        assert np.abs(w - (v + g * t)).max() < rounding
        assert np.abs(end - (x + v * t + g * t**2 / 2)).max() < rounding


@each("shape", [(16, 1), (16, 16), (5, 19)])
def test_hanging_sheet_comes_to_its_static_solution(variant, shape):
    scene = cs.scenes.hanging(shape, mass=0.01 * shape[0] * shape[1])
    state = scene.initial_position, scene.initial_velocity
    x, v = cs.step(scene, *state, 2e-3, 2000, **variant.options)
    rows = shape[0]
    row = np.arange(rows)
    sag = 0.01 * 9.80665 / 1000 * row * (2 * rows - row - 1) / 2
    y = -row / (rows - 1) - sag
    bound = {"double": 1e-12, "single": 1e-6}[variant.precision]
    assert np.abs(x[..., 1] - y[:, None]).max() < bound
    assert np.abs(x[..., [0, 2]] - scene.initial_position[..., [0, 2]]).max() < bound


@cases()
@each("shape", [(17, 17), (9, 33), (2, 1), (1, 5)])
def test_a_sheet_at_rest_stays_at_rest(variant, shape):
    """Exactly in double and in the gather kernel: rest lengths are rounded like lengths of springs.

    The edge kernel in single: the length is l^2 times a rounded 1/l, which differs from the rest length by one
    unit in the last place (by up to three with AVX2's estimate).
    """
    rows, columns = shape
    cloth = cs.Cloth(shape, size=((rows - 1) / 16 or 1, (columns - 1) / 16 or 1), pins=())
    x, v = cloth.rest_positions, np.zeros((*shape, 3))
    after = cs.step(cs.Scene(cloth, gravity=(0, 0, 0)), x, v, 5e-4, 1000, **variant.options)
    if variant.kernel == "gather" or variant.precision == "double":
        np.testing.assert_array_equal(after[0], x)
        np.testing.assert_array_equal(after[1], v)
        return
    assert np.abs(after[0] - x).max() < 3 * 2.0**-24
    assert np.abs(after[1]).max() < 300 * 2.0**-24
