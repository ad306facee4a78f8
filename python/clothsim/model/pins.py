"""Pins of a cloth: pairs (row, column), a mask, or a mapping of pairs to motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import check
from .motion import Motion, checked_motion, motion_from_dict

PinField = tuple[tuple[int, int], ...] | Mapping[tuple[int, int], Motion | None]


@dataclass(frozen=True)
class DrivenPins:
    """Pins that share a motion."""

    motion: Motion
    rows: npt.NDArray[np.int64]  # of their points
    columns: npt.NDArray[np.int64]
    starts: npt.NDArray[np.float64]  # (pins, 3): the ``center0`` with which each begins at its initial position [m]

    def places_at(self, t: float) -> npt.NDArray[np.float64]:
        """Places at the time `t` [m], shape (pins, 3)."""
        return np.broadcast_to(self.motion._center(np.array(t), self.starts), self.starts.shape)


def groups_of(pins: Mapping[tuple[int, int], Motion | None]) -> list[dict[str, Any]]:
    """Pins with motions as plain data: the points of each motion."""
    groups: dict[Motion | None, list[list[int]]] = {}
    for pair, motion in pins.items():
        groups.setdefault(motion, []).append(list(pair))
    return [
        {"points": points, **({} if motion is None else {"motion": motion.to_dict()})} for motion, points in groups.items()
    ]


def checked_pins(value: Any, shape: tuple[int, int]) -> PinField:
    """The argument `pins` of a cloth, checked."""
    accepted = f"pins must be (row, column) pairs, a mapping of such pairs to motions, or a boolean array of shape {shape}"
    if isinstance(value, Mapping):
        return _driven_pins(value, shape)
    if isinstance(value, (list, tuple)) and value and all(isinstance(one, Mapping) for one in value):
        return _driven_pins(_from_groups(value), shape)  # as in to_dict
    if isinstance(value, (str, bytes)) or not np.iterable(value):
        raise TypeError(f"{accepted}, got {check.shown(value)}")
    value = value if isinstance(value, np.ndarray) else list(value)
    mask: Any = np.empty(0)
    with suppress(ValueError, OverflowError):  # pairs of several lengths, or huge numbers
        mask = np.asarray(value)
    if mask.dtype == np.bool_:
        if mask.shape != shape:
            raise ValueError(f"{accepted}, got a boolean array of shape {mask.shape}")
        return tuple((int(r), int(c)) for r, c in np.argwhere(mask))
    pins = []
    for k, pair in enumerate(value):
        r, c = check.items(f"pins[{k}]", pair, 2, "integers (row, column)")
        r, c = (
            check.integer(f"pins[{k}][{axis}]", p, minimum=-n, maximum=n - 1)
            for axis, (p, n) in enumerate(zip((r, c), shape, strict=True))
        )
        pins.append((r, c))
    return tuple(pins)


def _driven_pins(value: Mapping[Any, Any], shape: tuple[int, int]) -> PinField:
    """The pins of a mapping; without any motion the pairs alone."""
    pairs = checked_pins(list(value), shape)
    motions = [checked_motion(f"pins[{pair}]", motion) for pair, motion in zip(pairs, value.values())]
    points = [(r % shape[0], c % shape[1]) for r, c in pairs]
    if len(set(points)) < len(points):
        twice = next(point for point in points if points.count(point) > 1)
        raise ValueError(f"pins must name each point once, got {twice} twice")
    if all(motion is None for motion in motions):
        return tuple(pairs)
    return MappingProxyType(dict(zip(pairs, motions)))


def _from_groups(groups: Sequence[Mapping[str, Any]]) -> dict[tuple[int, int], Motion | None]:
    pins: dict[tuple[int, int], Motion | None] = {}
    for k, group in enumerate(groups):
        given = check.keys(f"pins[{k}]", group, ("points", "motion"), required=("points",))
        motion = given.get("motion")
        motion = motion_from_dict(motion) if isinstance(motion, Mapping) else motion
        for pair in given["points"]:
            row, column = check.items(f"pins[{k}] points", pair, 2, "integers (row, column)")
            pins[row, column] = motion
    return pins
