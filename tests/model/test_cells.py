"""Radii of cells against another formula, and of chains against their links."""

import numpy as np
import pytest
from cell_oracle import point_radii
from clothsim.model.mesh import point_radii2


@pytest.mark.parametrize("shape", [(2, 2), (5, 7), (12, 9)])
def test_radii_are_those_of_the_oracle(shape):
    x = np.random.default_rng(3).normal(size=(*shape, 3))
    assert np.sqrt(point_radii2(x)) == pytest.approx(point_radii(x), rel=1e-13)


@pytest.mark.parametrize("shape", [(1, 6), (6, 1)])
def test_a_chain_has_half_its_longer_link(shape):
    x = np.random.default_rng(3).normal(size=(6, 3))
    half = np.pad(np.linalg.norm(np.diff(x, axis=0), axis=-1) / 2, 1)
    assert np.sqrt(point_radii2(x.reshape(*shape, 3))).ravel() == pytest.approx(np.maximum(half[1:], half[:-1]), rel=1e-13)
