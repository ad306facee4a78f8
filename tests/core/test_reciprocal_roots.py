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


def test_dense_mantissas_of_single(instruction_set):
    """Squares from 1 to 4 m^2: the result has the exponent of the square and a mantissa of these two of them."""
    seen = np.zeros(2**24, bool)
    steps = np.sqrt(np.linspace(0, 1.5, 5))
    for z in steps.astype(np.float32):
        low, high = np.sqrt(max(1 - z**2, 1e-3)), np.sqrt(4 - z**2)
        x = np.arange(low, high, 2.0**-22, dtype=np.float64).astype(np.float32)
        worst, squared = ulps(instruction_set, x, np.full_like(x, z))
        assert worst <= 2
        squared = squared[(squared >= 1) & (squared < 4)]
        seen[squared.view(np.uint32) - np.float32(1).view(np.uint32)] = True
    assert seen.mean() > 0.5  # of all mantissas there are


def test_dense_mantissas_of_double(instruction_set):
    rng = np.random.default_rng(2)
    even = np.linspace(1, 2, 2**20)
    for x in (even, even * (1 + rng.uniform(0, 1e-6, even.size))):
        assert ulps(instruction_set, x, np.zeros_like(x))[0] <= 2


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
