"""Types of arguments and results, for annotations in code that calls clothsim.

>>> from clothsim.typing import Response
>>> def methods() -> list[Response]:
...     return ["reflect", "ray"]
>>> len(methods())
2
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

Response: TypeAlias = Literal["reflect", "ray", "continuous"]
"""Contact responses of a `Sphere`."""

Offset: TypeAlias = Literal["none", "edge", "face"]
"""Offsets of a `Sphere` that have a name."""

Family: TypeAlias = Literal["structural", "shear", "bend"]
"""Spring families of a `Cloth`."""

DampingModel: TypeAlias = Literal["spring", "point"]
"""Damping models of a `Cloth`."""

Precision: TypeAlias = Literal["double", "single"]
"""Precisions of the arithmetic."""

Kernel: TypeAlias = Literal["auto", "gather", "edge"]
"""Kernels of the core."""

Backend: TypeAlias = Literal["cpu", "gpu"]
"""Processors that step a scene."""

Integrator: TypeAlias = (
    Literal[
        "rk4", "semi_implicit_euler", "velocity_verlet", "pefrl", "dopri5", "dop853", "implicit_midpoint", "auto",
    ]
    | str
)  # fmt: skip
"""Names of integrators. Any str passes, as `clothsim.integrators` also knows other spellings."""

Every: TypeAlias = float | Literal["step"]
"""Time between stored frames [s], steps between them (an int), or each step."""

Numbers: TypeAlias = Sequence[float] | npt.NDArray[np.integer[Any] | np.floating[Any]]
"""Real numbers in order: a list, a tuple or an array of one dimension."""

Shape: TypeAlias = Sequence[int] | npt.NDArray[np.integer[Any]]
"""Rows and columns of a grid."""

Pins: TypeAlias = Iterable[Sequence[int]] | npt.NDArray[np.bool_ | np.integer[Any]]
"""Pairs (row, column) of pinned points, or a boolean mask of the shape of the cloth."""
