"""The compute shader's thread grid: index = y * width + x, groups of 16 x 16 x 1."""

import clothsim as cs
import numpy as np
import pytest
from tables import each

SHAPES = [(32, 32), (16, 16), (2, 2), (1, 2), (2, 1), (1, 33), (17, 33), (40, 7), (3, 50), (15, 16)]


@each("shape", SHAPES)
def test_is_the_formula_of_the_shader(shape):
    grid, (y, x) = cs.thread_grid(shape), np.indices(shape)
    assert grid.shape == shape
    for axis, at in (("x", x), ("y", y)):
        np.testing.assert_array_equal(grid[f"dispatch_{axis}"], at)
        np.testing.assert_array_equal(grid[f"group_{axis}"], at // 16)
        np.testing.assert_array_equal(grid[f"thread_{axis}"], at % 16)
    np.testing.assert_array_equal(grid["index"], y * shape[1] + x)


@pytest.mark.parametrize("shape", [(2, 2), (3, 7), (17, 33)], ids=str)
def test_triangles_cover_every_cell_once_and_their_normals_point_up(shape):
    triangles = cs.triangles(shape)
    assert triangles.shape == (2 * (shape[0] - 1) * (shape[1] - 1), 3)
    x = cs.Cloth(shape=shape, size=(2.0, 3.0)).rest_positions.reshape(-1, 3)
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert (normal[:, 1] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1).sum() / 2, 6.0, rtol=1e-12)


@pytest.mark.parametrize("shape", [(1, 9), (9, 1)])
def test_a_chain_has_no_triangles(shape):
    assert cs.triangles(shape).shape == (0, 3)
