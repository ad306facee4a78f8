"""The members of a sweep: products of values, zipped lists, or samples.

Values become plain data, labels and digests.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import check
from ..model.fields import check_sweep_name, unit_of_name
from ..model.record import Record

# An array with more entries is described by its digest.
_MOST_ENTRIES = 64


def plain_data(value: Any) -> Any:
    """Convert `value` to data for JSON; equal values give equal data."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, Record):
        return plain_data(value.to_dict())
    if isinstance(value, Mapping):
        return {str(key): plain_data(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray) and value.size > _MOST_ENTRIES:
        return {
            "shape": list(value.shape),
            "dtype": value.dtype.str,
            "sha256": hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest(),
        }
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain_data(entry) for entry in value]
    raise TypeError(
        "a swept value must be a number, text, sequence, array, or part of a scene, got "
        f"{check.value_text(value)}"
    )


def digest_text(value: Any) -> str:
    """Make a short text that is equal for equal values alone."""
    return hashlib.sha256(json.dumps(plain_data(value), sort_keys=True).encode()).hexdigest()


def coordinate_label(value: Any) -> str:
    """Make a short text of `value` for a coordinate."""
    if isinstance(value, (bool, int, float, str)):
        return f"{value:g}" if isinstance(value, float) else str(value)
    if isinstance(value, (list, tuple)) and value:
        for kind, separator in ((str, "+"), (int, "x"), ((int, float), ",")):
            if all(isinstance(entry, kind) for entry in value):
                return separator.join(map(coordinate_label, value))
    if isinstance(value, Mapping) and value:
        return ",".join(f"{key}={coordinate_label(entry)}" for key, entry in value.items())
    text = json.dumps(plain_data(value))
    return text if len(text) <= 24 else f"{type(value).__name__} {digest_text(value)[:8]}"


@dataclass(frozen=True)
class Axis:
    """One dimension of a sweep: the values of one or more names at each place along it."""

    dimension: str
    places: tuple[Mapping[str, Any], ...]
    labels: tuple[str, ...] | None = None  # labels of the user; else they are made from the values

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.places[0])

    def __len__(self) -> int:
        return len(self.places)

    def values_of(self, name: str) -> list[Any]:
        return [place[name] for place in self.places]


class Grid:
    """All members of a sweep; the number of each is its flat index, last dimension fastest."""

    def __init__(self, axes: Sequence[Axis]) -> None:
        self.axes = tuple(axes)
        self.dimensions = tuple(axis.dimension for axis in self.axes)
        self.shape = tuple(map(len, self.axes))
        self.size = math.prod(self.shape)
        self.names = tuple(name for axis in self.axes for name in axis.names)
        repeats = {name for name in self.names if self.names.count(name) > 1}
        if repeats:
            raise ValueError(
                f"over must name each thing once, got {sorted(repeats)} more than once"
            )

    def member_values(self, index: int) -> dict[str, Any]:
        """Return the swept values of a member, by name."""
        values = dict[str, Any]()
        for axis, length in zip(reversed(self.axes), reversed(self.shape), strict=True):
            index, place = divmod(index, length)
            values = {**axis.places[place], **values}
        return values

    def coordinates(self) -> dict[str, Any]:
        """Return labels as xarray takes them.

        Each swept name has a label, a swept shape two more, and each member its number.
        """
        coordinates: dict[str, Any] = {}
        for axis in self.axes:
            for name in axis.names:
                labels = axis.labels if axis.dimension == name else None
                coordinates |= _label_coordinates(
                    name, axis.dimension, axis.values_of(name), labels
                )
            if axis.dimension not in axis.names:
                coordinates[axis.dimension] = axis.dimension, np.arange(len(axis))
        coordinates["member"] = self.dimensions, np.arange(self.size).reshape(self.shape)
        return coordinates

    def plain_axes(self) -> list[dict[str, Any]]:
        """Return the grid as plain data, to be compared with another."""
        return [
            {
                "dimension": axis.dimension,
                **({"labels": list(axis.labels)} if axis.labels else {}),
                "values": {
                    name: [plain_data(v) for v in axis.values_of(name)] for name in axis.names
                },
            }
            for axis in self.axes
        ]


def _label_coordinates(
    name: str, dimension: str, values: list[Any], labels: Sequence[str] | None
) -> dict[str, Any]:
    attrs: dict[str, Any] = {"long_name": name.replace("_", " ")}
    if labels is None and all(isinstance(v, bool) for v in values):
        return {name: (dimension, np.array(values), attrs)}
    if not all(isinstance(v, str) for v in values) and unit_of_name(name):
        attrs["units"] = unit_of_name(name)
    numbers = [np.nan if v is None else v for v in values]  # None, as of dt beside rtol, is NaN.
    are_numbers = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in numbers)
    if labels is None and are_numbers and any(v is not None for v in values):
        return {name: (dimension, np.array(numbers), attrs)}
    texts = list(labels or map(coordinate_label, values))
    if dimension == name and len(set(texts)) < len(texts):
        texts = [f"{text} #{k}" for k, text in enumerate(texts)]
    coordinates = {name: (dimension, np.array(texts), attrs)}
    if name == "shape" and labels is None:
        for part, side in enumerate(("rows", "columns")):
            coordinates[side] = dimension, np.array([v[part] for v in values]), {}
    return coordinates


def make_grid(over: Any) -> Grid:
    """Make the grid that the argument `over` of `sweep` describes."""
    if over is None:
        return Grid(())
    if isinstance(over, Mapping):
        return Grid([_make_axis(key, values) for key, values in over.items()])
    return Grid([_make_samples_axis(over)])


def _make_axis(key: Any, values: Any) -> Axis:
    """Make the axis of a name, or of names with zipped values."""
    is_zip = isinstance(key, tuple)
    labels = None
    names = tuple(map(check_sweep_name, key if is_zip else (key,)))
    if len(set(names)) < len(names):
        raise ValueError(f"over must name each thing once, got the zipped names {names!r}")
    if isinstance(values, Mapping) and not is_zip:
        labels = tuple(map(str, values))
        values = list(values.values())
    rows = [row if is_zip else (row,) for row in _list_values(f"over[{key!r}]", values)]
    for k, row in enumerate(rows):
        if not isinstance(row, (tuple, list)) or len(row) != len(names):
            requirement = f"{len(names)} value{'s' * (len(names) > 1)} in each row"
            raise ValueError(
                f"over[{key!r}] must have {requirement}, got {check.value_text(row)} at index {k}"
            )
    return Axis("_".join(names), tuple(dict(zip(names, row, strict=True)) for row in rows), labels)


def _make_samples_axis(over: Any) -> Axis:
    """Make the axis of samples: mappings, or a table with ``to_dict("records")``."""
    if hasattr(over, "to_dict") and not isinstance(over, Record):
        over = over.to_dict("records")
    samples = _list_values("over", over)
    for k, sample in enumerate(samples):
        if not isinstance(sample, Mapping) or not sample:
            requirement = "a mapping of names to values or a sequence of mappings"
            raise TypeError(
                f"over must be {requirement}, got {check.value_text(sample)} at index {k}"
            )
        if set(sample) != set(samples[0]):
            names = f"{sorted(sample)} at index {k} and {sorted(samples[0])} before"
            raise ValueError(f"over must give every sample the same names, got {names}")
    places = [
        {check_sweep_name(n): _python_scalar(v) for n, v in sample.items()} for sample in samples
    ]
    return Axis("sample", tuple(places))


def _list_values(name: str, values: Any) -> list[Any]:
    if (
        isinstance(values, (str, bytes, Record))
        or not isinstance(values, Iterable)
        or getattr(values, "ndim", 1) == 0
    ):
        raise TypeError(f"{name} must be a sequence of values, got {check.value_text(values)}")
    result = list(map(_python_scalar, values))
    if not result:
        raise ValueError(f"{name} must have at least one value, got none")
    return result


def _python_scalar(value: Any) -> Any:
    """Convert a NumPy scalar to a Python number, and return other values unchanged."""
    return value.item() if isinstance(value, np.generic) else value
