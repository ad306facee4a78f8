"""What goes into the core comes out of it, for rows that fill vectors and rows that do not."""

import itertools

import clothsim as cs
import numpy as np
from tables import each
from variants import cases

# The last has points enough for each of two threads to copy some of the rows.
SHAPES = [(2, 2), (3, 5), (2, 17), (5, 31), (32, 32), (3, 33), (2, 48), (3, 64), (2, 127), (97, 90)]
# More than the caches hold, in rows that do not begin where a vector does.
LARGE = (17, 21_001)


def state(shape, dtype):
    """Every number another one, some of them zeros of either sign."""
    rng = np.random.default_rng(1)
    cloth = cs.Cloth(shape, (0.9, 1.3))
    x = cloth.rest_positions + 0.01 * rng.normal(size=(*shape, 3))
    v = rng.normal(size=(*shape, 3))
    v[rng.random(v.shape) < 0.1] = 0.0
    v[rng.random(v.shape) < 0.1] *= -0.0
    x[..., 1][rng.random(shape) < 0.2] *= -0.0
    return cs.Scene(cloth), x.astype(dtype), v.astype(dtype)


def stored_values(values, precision):
    """Return what the core holds of numbers: in single a float32, and the rest in another."""
    values = values.astype(np.float64)
    if precision == "double":
        return values
    high = values.astype(np.float32)
    low = (values - high).astype(np.float32)
    return high.astype(np.float64) + low


@cases()
@each("shape", [*SHAPES, LARGE])
def test_a_state_comes_out_as_it_went_in(variant, shape):
    for dtype in (np.float64, np.float32):
        scene, x, v = state(shape, dtype)
        stepper = cs.Stepper(scene, x, v, **{**variant.options, "threads": 2})
        free = ~scene.cloth.pinned[..., None]
        pairs = ((stepper.positions, x), (stepper.velocities, np.where(free, v, 0.0)))
        for result, values in pairs:
            expected = stored_values(values, variant.precision).astype(dtype)
            assert result.dtype == dtype
            np.testing.assert_array_equal(result, expected)
            if variant.precision == "double":
                np.testing.assert_array_equal(np.signbit(result), np.signbit(expected))


@cases(precision=["single"])
def test_copies_are_exact_far_from_the_origin(variant):
    """Single keeps positions relative to the cloth's middle there; every component has its own."""
    for shape, dtype in itertools.product(SHAPES, (np.float64, np.float32)):
        scene, x, v = state(shape, dtype)
        x = x + np.array([1e4, -3e5, 7e3], dtype)
        scene = scene.replace(position=x.astype(np.float64))
        stepper = cs.Stepper(scene, x, v, **{**variant.options, "threads": 2})
        low, high = (f(x.reshape(-1, 3).astype(np.float64), axis=0) for f in (np.min, np.max))
        middle = low / 2 + high / 2
        expected = (stored_values(x.astype(np.float64) - middle, "single") + middle).astype(dtype)
        np.testing.assert_array_equal(stepper.positions, expected)
        assert (np.abs(stepper.positions - x) <= np.spacing(np.abs(x))).all()
