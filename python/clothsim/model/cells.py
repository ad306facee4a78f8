"""Cells of a cloth, as the offset "cell" of spheres takes them."""

from __future__ import annotations

import numpy as np

from ..base import Floats


def point_radii2(x: Floats) -> Floats:
    """rho^2 of each mass point of (rows, columns, 3) positions (docs/contact-law.md, cells).

    rho is the largest radius of a smallest enclosing circle among the triangles of the four cells around the point [m]. Both
    diagonals of a cell count.

    >>> import clothsim as cs
    >>> point_radii2(cs.Cloth((2, 2), (2.0, 2.0)).rest_positions).tolist()
    [[2.0, 2.0], [2.0, 2.0]]
    """
    rows, columns = x.shape[:2]
    x = np.pad(x, ((0, int(rows == 1)), (0, int(columns == 1)), (0, 0)), mode="edge")  # the links of a chain
    a, b, c, d = x[:-1, :-1], x[:-1, 1:], x[1:, :-1], x[1:, 1:]
    cells = np.max([_circle2(*corners) for corners in ((a, b, c), (b, d, c), (a, b, d), (a, d, c))], axis=0)
    around = np.pad(cells, 1)
    of_points = [around[i : i + x.shape[0], j : j + x.shape[1]] for i in (0, 1) for j in (0, 1)]
    found: Floats = np.max(of_points, axis=0)[:rows, :columns]
    return found


def _circle2(a: Floats, b: Floats, c: Floats) -> Floats:
    """Squared radius of the smallest circle around triangles: around the longest side, or through all corners."""
    sides = np.stack([((p - q) ** 2).sum(axis=-1) for p, q in ((a, b), (b, c), (c, a))])
    longest, product = sides.max(axis=0), sides.prod(axis=0)
    area2 = (np.cross(b - a, c - a) ** 2).sum(axis=-1)  # of the parallelogram
    acute = 2 * longest < sides.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        circle: Floats = np.where(acute, product / (4 * area2), longest / 4)
    return circle
