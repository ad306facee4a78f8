"""Types of arguments and results, for annotations in code that calls clothsim.

>>> from clothsim.typing import Response
>>> def methods() -> list[Response]:
...     return ["reflect", "ray"]
>>> len(methods())
2
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np
import numpy.typing as npt

Response: TypeAlias = Literal["reflect", "ray", "continuous"]
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
        "implicit_midpoint",
        "auto",
    ]
    | str
)
"""Names of integrators; any other str passes too."""

Every: TypeAlias = float | Literal["step"]
"""Time between stored frames [s], steps between them (an int), or each step."""

Numbers: TypeAlias = Sequence[float] | npt.NDArray[np.integer[Any] | np.floating[Any]]
"""Real numbers in order: a list, a tuple or an array of one dimension."""

Shape: TypeAlias = Sequence[int] | npt.NDArray[np.integer[Any]]
"""Rows and columns of a grid."""

Pins: TypeAlias = Iterable[Sequence[int]] | npt.NDArray[np.bool_ | np.integer[Any]] | Mapping[tuple[int, int], Any]
"""Pairs (row, column) of pinned points, a boolean mask of the cloth's shape, or a mapping of pairs to motions or None."""


class Estimate(TypedDict):
    max: float
    rms: float
    reason: str


class Tolerance(TypedDict):
    asked: float
    reached: bool


class EnergyParts(TypedDict):
    kinetic: float
    elastic: float
    gravity: float
    force: float
    total: float


class Energies(TypedDict):
    start: EnergyParts
    end: EnergyParts
    gained: float
    reason: str


class Depths(TypedDict):
    points: float
    triangles: float
    reason: str


class Stretch(TypedDict):
    largest: float
    reason: str


class FirstContact(TypedDict):
    time: float
    reason: str


class Report(TypedDict):
    """`Run.report`; `simulate` describes the entries. A number that is unknown is NaN, with a reason."""

    steps: int
    rejected_steps: int
    force_evaluations: int
    solution_evaluations: int
    wall_time: float
    steps_per_second: float
    dt: float
    stopped: str
    residual: float
    reason: str
    error_estimate: Estimate
    estimate_evaluations: int
    estimate_wall_time: float
    tolerance: Tolerance
    energy: Energies
    force_work: float
    penetration: Depths
    stretch: Stretch
    first_contact: FirstContact
    impulse: list[list[float]]
    impulse_reason: str
    lift_work: float
    kernel: str
    integrator: str
    as_printed: bool
    precision: str
    threads: int
    instruction_set: str
    backend: str
    version: str
