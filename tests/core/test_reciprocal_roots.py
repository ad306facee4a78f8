"""1/l of the fused kernels, by estimate and Newton steps: never more than 2 ulp from the exact one."""

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core

# What the kernels add to every squared length [m^2], and the longest distance there is, to padding [m].
SMALLEST, LONGEST = 1e-36, 1.7e15


@pytest.fixture(params=cs.build_config()["instruction_sets_supported"])
def instruction_set(request):
    return request.param


def ulps(instruction_set, x, z):
    """Largest error of 1/l, in units of the last place, and the squares it was taken of."""
    squared, got = _core.fused_lengths(instruction_set, x, z)
    # With 64 bits of mantissa, or 53 for single: many more than are looked at.
    exact = 1 / np.sqrt(squared.astype(np.longdouble if x.dtype == np.float64 else np.float64))
    assert (got > 0).all() and np.isfinite(got).all()
    return float((np.abs(got - exact) / np.spacing(exact.astype(x.dtype))).max()), squared


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_exponent_of_a_length(instruction_set, dtype):
    """Lengths from below what is added to the distance of padding."""
    rng = np.random.default_rng(1)
    exponents = np.arange(np.floor(np.log2(SMALLEST) / 2) - 1, np.log2(LONGEST))
    mantissas = np.concatenate(
        [1 + np.arange(128) / 128, 2 - np.arange(1, 128) * np.finfo(dtype).eps, rng.uniform(1, 2, 4000)]
    )
    x = (2.0 ** exponents[:, None] * mantissas).astype(dtype).ravel()
    worst, squared = ulps(instruction_set, x, np.zeros_like(x))
    assert squared.min() <= 1.3 * SMALLEST and squared.max() > 1e30
    assert np.unique(np.frexp(squared)[1]).size >= 220
    assert worst <= 2


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_guard_of_coincident_points_changes_no_length(instruction_set, dtype):
    """From a tenth of a nanometre on it is below rounding, and two coincident points have a finite 1/l."""
    lengths = np.concatenate([np.logspace(-10, 15, 20_001), 1e-10 * np.linspace(1, 2, 2001)]).astype(dtype)
    _, got = _core.fused_lengths(instruction_set, lengths, np.zeros_like(lengths))
    exact = 1 / lengths.astype(np.longdouble)
    # The square is rounded too, which the root halves.
    assert (np.abs(got - exact) <= 2.5 * np.spacing(exact.astype(dtype))).all()
    _, at_0 = _core.fused_lengths(instruction_set, np.zeros(1, dtype), np.zeros(1, dtype))
    np.testing.assert_allclose(at_0, 1e18, rtol=1e-6, atol=0)
