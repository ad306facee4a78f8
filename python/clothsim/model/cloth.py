"""The cloth: mass points on a regular grid, springs between them, and which points are pinned."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check, make_read_only
from ..typing import Family, Numbers, Pins, Shape
from .mesh import check_shape
from .motion import Motion, check_motion, motion_from_dict
from .record import Record

PinField = tuple[tuple[int, int], ...] | Mapping[tuple[int, int], Motion | None]

FAMILIES: tuple[Family, ...] = get_args(Family)
"""The spring families, in the order in which they are computed and listed."""

SPRING_DTYPE = np.dtype(
    [
        ("i", "i8"),
        ("j", "i8"),
        ("family", "U10"),
        ("rest_length", "f8"),
        ("stiffness", "f8"),
        ("damping", "f8"),
    ]
)

# The (row, column) offsets of a spring's two ends from a cell's corner, per family and direction,
# are in the order of the spring table.
_ENDS = tuple(
    (family, *ends)
    for family, r, c in _core.spring_kinds
    for ends in [((0, 0), (r, c)), ((0, c), (r, 0))][
        : 2 if r and c else 1
    ]  # a diagonal has a mirror image
)

# These can be replaced beside everything else: arrays and pins stay.
_FORCES = {"stiffness", "damping"}


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Cloth(Record):
    """A rectangular sheet of mass points and springs (Kim et al., section 2; defaults Table 2).

    The spring between the points i and j pulls i with this force. It is eq 1 of Kim et al. with the
    printed plus sign corrected, and damping along the spring::

        F = (stiffness (|d| - rest_length) - damping (v_i - v_j) . n) n,  d = x_j - x_i, n = d/|d|

    Drag acts on each point with the force -drag v. Both kinds of damping may act together.

    Cloths are immutable, equal by value, and plain data (``to_dict``).

    Parameters
    ----------
    shape : (int, int), default (32, 32)
        Rows and columns, each >= 1 and at least two points in all. One row or column is a chain.
    size : (float, float), default (1.0, 1.0)
        Extent along the rows and along the columns [m], > 0, in the order of `shape`. The extent
        along an axis with a single point has no effect.
    mass : float or array_like, default 512.0
        Total mass [kg], spread evenly, or the mass of each point, shape (rows, columns) [kg]; > 0.
    stiffness : float or mapping, default 35000.0
        Stiffness of each spring [N/m], >= 0: one number, or a mapping with one number for every
        family in `springs`.
    damping : float or mapping, default 100.0
        Damping of the change of each spring's length [N s/m], >= 0: one number, or a mapping with
        one number for every family in `springs`. Zero switches it off.
    drag : float, default 0.0
        Damping of each point's velocity v with the force -drag v [N s/m], >= 0.
    springs : sequence of str, default ("structural", "shear", "bend")
        Families present. Structural springs join neighbours, shear springs the diagonals of a
        cell, bend springs points two apart along a row or column. Kept in this order.
    pins : sequence of (int, int), boolean array or mapping, default ((0, 0), (-1, 0))
        Points that no force moves: (row, column) pairs, or a mask of shape (rows, columns).
        Negative numbers count from the end. An empty sequence pins no point. A mapping gives each
        pin a motion, or None for a pin that rests: ``{(0, 0): cs.Linear((1, 0, 0)), (-1, 0):
        None}``. A pin with a motion is driven: it starts from its place in the scene's initial
        state. With `Reciprocate` that place is a turning point.

    Attributes
    ----------
    rows, columns : int
        The two entries of `shape`.
    spacing : (float, float)
        Distance between neighbouring rows and between neighbouring columns at rest [m]; 0 along
        an axis with a single point.
    damped : bool
        Whether any force depends on velocities.
    uniform_mass : bool
        Whether all points have the same mass.
    family_stiffness, family_damping : dict
        Stiffness [N/m] and spring damping [N s/m] of every family present.
    mass_per_point : numpy.ndarray
        Masses [kg], shape (rows, columns), read-only.
    pinned : numpy.ndarray
        True where a point is pinned, at rest or driven, shape (rows, columns), read-only.
    driven : dict
        The motion of each driven pin, by (row, column) >= 0.
    rest_positions : numpy.ndarray
        The flat sheet [m], shape (rows, columns, 3), read-only: point (row, column) is at
        (column size[1]/(columns - 1), 0, row size[0]/(rows - 1)).

    Examples
    --------
    >>> cloth = cs.Cloth(springs=("structural", "shear"))
    >>> cloth.spring_count(), float(cloth.mass_per_point[0, 0])
    (3906, 0.5)
    >>> soft = cloth.replace(stiffness={"structural": 35_000.0, "shear": 1_000.0})
    >>> soft.family_stiffness
    {'structural': 35000.0, 'shear': 1000.0}
    """

    shape: tuple[int, int]
    size: tuple[float, float]
    mass: float | npt.NDArray[np.float64]
    stiffness: float | Mapping[str, float]
    damping: float | Mapping[str, float]
    drag: float
    springs: tuple[Family, ...]
    pins: PinField

    @check.check_names
    def __init__(
        self,
        shape: Shape = (32, 32),
        size: Numbers = (1.0, 1.0),
        mass: npt.ArrayLike = 512.0,
        stiffness: float | Mapping[str, float] = 35_000.0,
        damping: float | Mapping[str, float] = 100.0,
        drag: float = 0.0,
        springs: Iterable[Family] = ("structural", "shear", "bend"),
        pins: Pins = ((0, 0), (-1, 0)),
    ) -> None:
        shape = check_shape(shape, least=2)
        springs = _check_springs(springs)
        sides = enumerate(check.list_of_items("size", size, 2, "numbers > 0"))
        self._set_attributes(
            shape=shape,
            size=tuple(
                check.number(f"size[{k}]", side, minimum=0, exclusive=True) for k, side in sides
            ),
            mass=_check_mass(mass, shape),
            stiffness=_check_per_family("stiffness", stiffness, springs),
            damping=_check_per_family("damping", damping, springs),
            drag=check.number("drag", drag, minimum=0),
            springs=springs,
            pins=_check_pins(pins, shape),
        )

    def replace(self, **changes: Any) -> Cloth:
        if not changes.keys() <= _FORCES:
            return super().replace(**changes)
        return self._copy_with_values(
            ("core",),
            **{
                name: _check_per_family(name, value, self.springs)
                for name, value in changes.items()
            },
        )

    def to_dict(self) -> dict[str, Any]:
        if not isinstance(self.pins, Mapping):
            return super().to_dict()
        return {**self.replace(pins=()).to_dict(), "pins": _pins_to_groups(self.pins)}

    @property
    def rows(self) -> int:
        return self.shape[0]

    @property
    def columns(self) -> int:
        return self.shape[1]

    @property
    def spacing(self) -> tuple[float, float]:
        (height, width) = self.size
        (rows, columns) = self.shape
        return height / (rows - 1) if rows > 1 else 0.0, width / (
            columns - 1
        ) if columns > 1 else 0.0

    @property
    def family_stiffness(self) -> dict[str, float]:
        return (
            dict.fromkeys(self.springs, self.stiffness)
            if isinstance(self.stiffness, float)
            else dict(self.stiffness)
        )

    @property
    def family_damping(self) -> dict[str, float]:
        return (
            dict.fromkeys(self.springs, self.damping)
            if isinstance(self.damping, float)
            else dict(self.damping)
        )

    @property
    def damped(self) -> bool:
        return self.drag > 0 or any(c > 0 for c in self.family_damping.values())

    @property
    def uniform_mass(self) -> bool:
        return not isinstance(self.mass, np.ndarray) or bool((self.mass == self.mass[0, 0]).all())

    @cached_property
    def mass_per_point(self) -> npt.NDArray[np.float64]:
        if isinstance(self.mass, np.ndarray):
            return self.mass
        return make_read_only(np.full(self.shape, self.mass / (self.rows * self.columns)))

    @cached_property
    def pinned(self) -> npt.NDArray[np.bool_]:
        mask = np.zeros(self.shape, dtype=np.bool_)
        for pin in self.pins:
            mask[pin] = True
        return make_read_only(mask)

    @cached_property
    def driven(self) -> dict[tuple[int, int], Motion]:
        if not isinstance(self.pins, Mapping):
            return {}
        rows, columns = self.shape
        return {
            (r % rows, c % columns): motion
            for (r, c), motion in self.pins.items()
            if motion is not None
        }

    @cached_property
    def rest_positions(self) -> npt.NDArray[np.float64]:
        positions = np.zeros((*self.shape, 3))
        positions[..., 0] = np.arange(self.columns) * self.size[1] / max(self.columns - 1, 1)
        positions[..., 2] = (np.arange(self.rows) * self.size[0] / max(self.rows - 1, 1))[:, None]
        return make_read_only(positions)

    @cached_property
    def core(self) -> _core.Cloth:
        """This cloth as the core takes it."""
        return _core.Cloth(
            rows=self.rows,
            columns=self.columns,
            row_spacing=self.spacing[0],
            column_spacing=self.spacing[1],
            stiffness=self.family_stiffness,
            spring_damping=self.family_damping,
            drag=self.drag,
            mass=self.mass_per_point,
            uniform_mass=self.uniform_mass,
            pinned=self.pinned,
        )

    def spring_count(self, family: Family | None = None) -> int:
        """Return the number of springs, of one family or in all.

        Parameters
        ----------
        family : {"structural", "shear", "bend"}, optional
            Default: all families present. A family that this cloth leaves out has 0 springs.

        Examples
        --------
        >>> cs.Cloth().spring_count("bend"), cs.Cloth().spring_count()
        (1920, 5826)
        """
        if family is not None:
            check.choice("family", family, FAMILIES)
        families = self.springs if family is None else (family,)
        return sum(
            math.prod(self._spring_counts_by_direction(*ends))
            for name, *ends in _ENDS
            if name in families and name in self.springs
        )

    def _spring_counts_by_direction(
        self, first: tuple[int, int], second: tuple[int, int]
    ) -> tuple[int, int]:
        """Return how many springs with these ends fit along the rows and along the columns."""
        rows, columns = (
            max(n - max(a, b), 0) for n, a, b in zip(self.shape, first, second, strict=True)
        )
        return rows, columns

    def spring_table(self) -> npt.NDArray[np.void]:
        """Return every spring, one row each.

        The order is structural (r, c)-(r, c+1) and (r, c)-(r+1, c); shear (r, c)-(r+1, c+1) and (r,
        c+1)-(r+1, c); bend (r, c)-(r, c+2) and (r, c)-(r+2, c). Each of these six is ordered by r,
        then by c.

        Returns
        -------
        numpy.ndarray
            Structured: ``i``, ``j`` (indices of the points), ``family``, ``rest_length`` [m],
            ``stiffness`` [N/m] and ``damping`` [N s/m].

        Examples
        --------
        >>> table = cs.Cloth(shape=(2, 2), springs=("structural",)).spring_table()
        >>> table[["i", "j", "rest_length"]].tolist()
        [(0, 1, 1.0), (2, 3, 1.0), (0, 2, 1.0), (1, 3, 1.0)]
        """
        stiffness = self.family_stiffness
        damping = self.family_damping
        table = np.empty(self.spring_count(), SPRING_DTYPE)
        first_row = 0
        for family, first, second in _ENDS:
            if family not in self.springs:
                continue
            rows, columns = self._spring_counts_by_direction(first, second)
            length = math.hypot(
                *(h * (b - a) for h, a, b in zip(self.spacing, first, second, strict=True))
            )
            corners = (np.arange(rows)[:, None] * self.columns + np.arange(columns)).ravel()
            springs = table[first_row : first_row + corners.size]
            for field, (r, c) in (("i", first), ("j", second)):
                springs[field] = corners + (r * self.columns + c)
            springs["family"] = family
            springs["rest_length"] = length
            springs["stiffness"] = stiffness[family]
            springs["damping"] = damping[family]
            first_row += corners.size
        return table


def _check_mass(value: Any, shape: tuple[int, int]) -> float | npt.NDArray[np.float64]:
    if check.real_or_none(value) is not None:
        return check.number("mass", value, minimum=0, exclusive=True)
    accepted = "finite numbers > 0 (or one number, the total mass)"
    masses = check.array("mass", value, shape, accepted)
    check.check_all("mass", masses, masses > 0, f"an array of shape {shape} of {accepted}")
    return make_read_only(masses)


def _check_springs(value: Any) -> tuple[Family, ...]:
    if isinstance(value, (str, bytes, Mapping)) or not np.iterable(value):
        raise TypeError(
            f"springs must be a sequence of names from {FAMILIES}, got {check.value_text(value)}"
        )
    names = [check.choice(f"springs[{k}]", name, FAMILIES) for k, name in enumerate(value)]
    if len(set(names)) < len(names):
        raise ValueError(f"springs must name each family once, got {names}")
    return tuple(family for family in FAMILIES if family in names)


def _check_per_family(name: str, value: Any, springs: Sequence[str]) -> float | Mapping[str, float]:
    if isinstance(value, float) or not isinstance(value, Mapping):
        return check.number(name, value, minimum=0)
    numbers = check.mapping(name, value, springs, required=springs)
    return MappingProxyType(
        {f: check.number(f"{name}[{f!r}]", numbers[f], minimum=0) for f in springs}
    )


def _pins_to_groups(pins: Mapping[tuple[int, int], Motion | None]) -> list[dict[str, Any]]:
    """Return pins with motions as plain data: the points of each motion."""
    groups: dict[Motion | None, list[list[int]]] = {}
    for pair, motion in pins.items():
        groups.setdefault(motion, []).append(list(pair))
    return [
        {"points": points, **({} if motion is None else {"motion": motion.to_dict()})}
        for motion, points in groups.items()
    ]


def _check_pins(value: Any, shape: tuple[int, int]) -> PinField:
    """Return the argument `pins` of a cloth, checked."""
    accepted = (
        "pins must be (row, column) pairs, a mapping of such pairs to motions, or a "
        f"boolean array of shape {shape}"
    )
    if isinstance(value, Mapping):
        return _check_driven_pins(value, shape)
    if (
        isinstance(value, (list, tuple))
        and value
        and all(isinstance(group, Mapping) for group in value)
    ):
        return _check_driven_pins(_pins_from_groups(value), shape)  # as in to_dict
    if isinstance(value, (str, bytes)) or not np.iterable(value):
        raise TypeError(f"{accepted}, got {check.value_text(value)}")
    if isinstance(value, np.ndarray) and value.dtype == np.bool_:
        if value.shape != shape:
            raise ValueError(f"{accepted}, got a boolean array of shape {value.shape}")
        return tuple((int(r), int(c)) for r, c in np.argwhere(value))
    pins = []
    for k, pair in enumerate(value):
        r, c = check.list_of_items(f"pins[{k}]", pair, 2, "integers (row, column)")
        r, c = (
            check.integer(f"pins[{k}][{axis}]", p, minimum=-n, maximum=n - 1)
            for axis, (p, n) in enumerate(zip((r, c), shape, strict=True))
        )
        pins.append((r, c))
    return tuple(pins)


def _check_driven_pins(value: Mapping[Any, Any], shape: tuple[int, int]) -> PinField:
    """Return the pins of a mapping; without any motion the pairs alone."""
    pairs = _check_pins(list(value), shape)
    motions = [check_motion(f"pins[{pair}]", motion) for pair, motion in zip(pairs, value.values())]
    points = [(r % shape[0], c % shape[1]) for r, c in pairs]
    if len(set(points)) < len(points):
        twice = next(point for point in points if points.count(point) > 1)
        raise ValueError(f"pins must name each point once, got {twice} twice")
    if all(motion is None for motion in motions):
        return tuple(pairs)
    return MappingProxyType(dict(zip(pairs, motions)))


def _pins_from_groups(groups: Sequence[Mapping[str, Any]]) -> dict[tuple[int, int], Motion | None]:
    pins: dict[tuple[int, int], Motion | None] = {}
    for k, group in enumerate(groups):
        entries = check.mapping(f"pins[{k}]", group, ("points", "motion"), required=("points",))
        motion = entries.get("motion")
        motion = motion_from_dict(motion) if isinstance(motion, Mapping) else motion
        for pair in entries["points"]:
            row, column = check.list_of_items(
                f"pins[{k}] points", pair, 2, "integers (row, column)"
            )
            pins[row, column] = motion
    return pins
