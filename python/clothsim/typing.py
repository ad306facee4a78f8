"""Types of arguments and results, for annotations in code that calls clothsim.

>>> from clothsim.typing import Response
>>> def methods() -> list[Response]:
...     return ["reflect", "ray"]
>>> len(methods())
2
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

Response: TypeAlias = Literal["penalty", "reflect", "ray"]
"""Contact responses of a `Sphere`."""

Offset: TypeAlias = Literal["none", "edge", "cell"]
"""Offsets of a `Sphere` that have a name."""

Family: TypeAlias = Literal["structural", "shear", "bend"]
"""Spring families of a `Cloth`."""

Precision: TypeAlias = Literal["double", "single"]
"""Precisions of the arithmetic."""

Kernel: TypeAlias = Literal["auto", "gather", "edge"]
"""Kernels of the core."""

Backend: TypeAlias = Literal["cpu", "gpu"]
"""Processors that step a scene."""

Integrator: TypeAlias = (
    Literal[
        "rk4",
        "explicit_euler",
        "semi_implicit_euler",
        "velocity_verlet",
        "pefrl",
        "dopri5",
        "dop853",
        "rkc2",
        "implicit_midpoint",
        "auto",
    ]
    | str
)
"""Names of integrators; any other str passes too."""

Force: TypeAlias = Callable[[float, Any, Any], npt.ArrayLike] | Any
"""A function f(t, x, v) of time [s], positions [m] and velocities [m/s], read-only arrays of shape
(rows, columns, 3), that returns the force on each mass point [N] in that shape; or a C function,
see `simulate`.
"""

Numbers: TypeAlias = Sequence[float] | npt.NDArray[np.integer[Any] | np.floating[Any]]
"""Real numbers in order: a list, a tuple or an array of one dimension."""

Shape: TypeAlias = Sequence[int] | npt.NDArray[np.integer[Any]]
"""Rows and columns of a grid."""

Pins: TypeAlias = (
    Iterable[Sequence[int]]
    | npt.NDArray[np.bool_ | np.integer[Any]]
    | Mapping[tuple[int, int], Any]
)
"""Pairs (row, column) of pinned points, a boolean mask of the cloth's shape, or a mapping of pairs
to motions or None.
"""
