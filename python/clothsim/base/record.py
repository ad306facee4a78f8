"""Base of value types: equality, hash, copies, plain data and a short repr."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from . import check

Self = TypeVar("Self", bound="Record")
Value = TypeVar("Value")


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        numbers = isinstance(a, np.ndarray) and a.dtype.kind == "f"
        return type(a) is type(b) and np.array_equal(a, b, equal_nan=numbers)
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(value, b[key]) for key, value in a.items())
    return bool(a == b) or (a != a and b != b)


# Longer arrays, and tuples of more numbers or records, are shown by their shape or length.
_SHOWN = 24
_RECORDS_SHOWN = 4


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        if value.size > _SHOWN:
            return f"<array of shape {value.shape}>"
        return repr(value.tolist())
    if isinstance(value, MappingProxyType):
        return repr(dict(value))
    if isinstance(value, tuple) and value:
        most = _RECORDS_SHOWN if isinstance(value[0], Record) else _SHOWN
        if len(value) > most:
            return f"<{len(value)} entries, the first {value[0]!r}>"
    return repr(value)


def _plain(value: Any) -> Any:
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value


def frozen(array: np.ndarray) -> np.ndarray:
    """`array` itself, made read-only."""
    array.flags.writeable = False
    return array


class ReadOnly(Mapping[str, Value]):
    """A mapping that cannot be changed; its subclasses print as tables."""

    def __init__(self, entries: Mapping[str, Value]) -> None:
        self._entries = entries

    def __getitem__(self, key: str) -> Value:
        return self._entries[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


class Record:
    """Base of the frozen dataclasses of the model: equal and hashed by value, arrays included."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        return all(_same(value, getattr(other, name)) for name, value in self._values().items())

    def __hash__(self) -> int:
        forms = (
            v.shape if isinstance(v, np.ndarray) else frozenset(v.items()) if isinstance(v, Mapping) else v
            for v in self._values().values()
        )
        return hash((type(self).__name__, *forms))

    def _values(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}  # type: ignore[arg-type]

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, so that a copy's arrays are read-only again.
        return partial(type(self), **self._open_values()), ()

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={_short(value)}" for name, value in self._values().items())
        return f"{type(self).__name__}({values})"

    def _open_values(self) -> dict[str, Any]:
        """The arguments by name; read-only mappings become plain dicts."""
        return {
            name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in self._values().items()
        }

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def replace(self: Self, **changes: Any) -> Self:
        """A copy with the named arguments of the constructor changed; the original stays as it is.

        Parameters
        ----------
        **changes

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Sphere(radius=0.25).replace(radius=0.5).radius
        0.5
        """
        return type(self)(**{**self._open_values(), **changes})

    def to_dict(self) -> dict[str, Any]:
        """The arguments as numbers, strings, lists and dicts, as JSON and TOML can hold them; None is left out.

        Examples
        --------
        >>> import clothsim as cs
        >>> cs.Cloth(shape=(4, 5)).to_dict()["shape"]
        [4, 5]
        """
        return {name: _plain(value) for name, value in self._open_values().items() if value is not None}

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        """The object that `data`, as from ``to_dict``, describes.

        Parameters
        ----------
        data : mapping
            Arguments of the constructor; missing ones take their defaults, unknown ones are a ValueError.

        Examples
        --------
        >>> import clothsim as cs
        >>> cloth = cs.Cloth(shape=(4, 5), mass=2.0)
        >>> cs.Cloth.from_dict(cloth.to_dict()) == cloth
        True
        """
        return cls(**cls._arguments(data))

    @classmethod
    def _arguments(cls, data: Mapping[str, Any], *more: str) -> dict[str, Any]:
        """`data` as a dict, its keys checked; `more` are keys beside the arguments."""
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        known = [*more, *(f.name for f in fields)]
        required = [*more, *(f.name for f in fields if f.default is dataclasses.MISSING)]
        return check.keys(cls.__name__, data, known, required)
