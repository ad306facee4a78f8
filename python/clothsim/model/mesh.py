"""The compute shader's thread grid, the triangles of the sheet, and the radii of its cells."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check

GROUP = (_core.group_size, _core.group_size, 1)


def check_shape(value: Any, least: int = 1) -> tuple[int, int]:
    """Return `value` as (rows, columns) of a grid with at least `least` mass points, which the core
    numbers in 32 bits.
    """
    numbers = check.list_of_items("shape", value, 2, "integers (rows, columns)")
    rows, columns = (check.integer(f"shape[{k}]", n, minimum=1) for k, n in enumerate(numbers))
    if not least <= rows * columns < 2**31:
        raise ValueError(
            f"shape must have {least:,} to {2**31 - 1:,} mass points, got {(rows, columns)}"
        )
    return rows, columns


@check.check_names
def thread_grid(
    shape: tuple[int, int], group: tuple[int, int, int] = GROUP
) -> npt.NDArray[np.void]:
    """Return the compute shader's thread for each mass point (Kim et al., section 3.1).

    One thread per mass point, groups of 16 x 16 x 1 threads::

        dispatch (x, y) = group (x, y) * 16 + thread (x, y)
        index           = dispatch y * width + dispatch x,    width = columns

    The number of groups is rounded up, and surplus threads do nothing.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the cloth, each >= 1.
    group : (int, int, int), default (16, 16, 1)
        Threads per group. The kernels are built for (16, 16, 1); others are refused.

    Returns
    -------
    numpy.ndarray
        Structured, shape (rows, columns), with the integer fields ``group_x``, ``group_y``,
        ``thread_x``, ``thread_y``, ``dispatch_x``, ``dispatch_y`` and ``index``.

    Examples
    --------
    >>> grid = cs.thread_grid((32, 32))
    >>> grid[17, 3]["index"], grid[17, 3]["group_y"], grid[17, 3]["thread_y"]
    (np.int64(547), np.int32(1), np.int32(1))
    """
    rows, columns = check_shape(shape)
    if tuple(check.list_of_items("group", group, 3, "integers")) != GROUP:
        raise ValueError(
            f"group must be {GROUP}, the one the kernels are built for, "
            f"got {check.value_text(group)}"
        )
    return _core.thread_ids(rows, columns)


@check.check_names
def triangles(shape: tuple[int, int]) -> npt.NDArray[np.int64]:
    """Return the triangles of the sheet: two per cell, split from (row, column + 1) to (row + 1,
    column).

    Corners run counterclockwise seen from above, so that normals of the flat sheet point up (+y).

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the cloth, each >= 1.

    Returns
    -------
    numpy.ndarray
        Indices of the corners, shape (2 (rows - 1) (columns - 1), 3).

    Examples
    --------
    >>> cs.triangles((2, 2)).tolist()
    [[0, 2, 1], [1, 2, 3]]
    """
    rows, columns = check_shape(shape)
    index = np.arange(rows * columns).reshape(rows, columns)
    a = index[:-1, :-1]
    b = index[:-1, 1:]
    c = index[1:, :-1]
    d = index[1:, 1:]
    return np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3)
