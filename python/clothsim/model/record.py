"""Base of the values of the model: frozen dataclasses that may hold arrays."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from ..base import check

Self = TypeVar("Self", bound="Record")


def _hashable_form(value: Any) -> Any:
    """Return a hashable form of a value, equal for equal values."""
    if isinstance(value, np.ndarray):
        return value.shape, (value + 0.0).tobytes()  # -0.0 is 0.0
    if isinstance(value, Mapping):
        return frozenset(value.items())
    return value


def _short_repr(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > 24:
        return f"<array of shape {value.shape}>"
    if isinstance(value, tuple) and len(value) > (
        4 if value and isinstance(value[0], Record) else 24
    ):
        return f"<{len(value)} entries, the first {value[0]!r}>"
    if isinstance(value, np.ndarray):
        return repr(value.tolist())
    if isinstance(value, Mapping):
        return repr(dict(value))
    return repr(value)


def _plain_data(value: Any) -> Any:
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {key: _plain_data(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain_data(entry) for entry in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


class Record:
    """Compared and hashed by value, arrays included. Copies go through the constructor, which keeps
    arrays read-only.
    """

    def __eq__(self, other: object) -> bool:
        return (
            self._hashable_arguments() == other._hashable_arguments()
            if isinstance(other, type(self))
            else NotImplemented
        )

    def __hash__(self) -> int:
        return hash(self._hashable_arguments())

    def _hashable_arguments(self) -> tuple[Any, ...]:
        return tuple(_hashable_form(value) for value in self._arguments_by_name().values())

    def _arguments_by_name(self) -> dict[str, Any]:
        """Return the arguments by name."""
        names = self.__match_args__  # type: ignore[attr-defined]
        return {name: getattr(self, name) for name in names}

    def __reduce__(self) -> tuple[Any, ...]:
        values = {
            n: dict(v) if isinstance(v, MappingProxyType) else v
            for n, v in self._arguments_by_name().items()
        }
        return partial(type(self), **values), ()

    def __repr__(self) -> str:
        values = ", ".join(
            f"{name}={_short_repr(value)}" for name, value in self._arguments_by_name().items()
        )
        return f"{type(self).__name__}({values})"

    def _set_attributes(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def replace(self: Self, **changes: Any) -> Self:
        """Return a copy with the named arguments of the constructor changed; the original stays as
        it is.

        Parameters
        ----------
        **changes

        Examples
        --------
        >>> cs.Sphere(radius=0.25).replace(radius=0.5).radius
        0.5
        """
        return type(self)(**{**self._arguments_by_name(), **changes})

    def _copy_with_values(self: Self, forget: Collection[str], **values: Any) -> Self:
        """Return a copy with other values, already checked, that shares what this record has
        cached, except `forget`.
        """
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__, **values)
        for name in forget:
            copy.__dict__.pop(name, None)
        return copy

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments as numbers, strings, lists and dicts, as JSON and TOML can hold
        them; None is left out.

        Examples
        --------
        >>> cs.Cloth(shape=(4, 5)).to_dict()["shape"]
        [4, 5]
        """
        return {
            name: _plain_data(value)
            for name, value in self._arguments_by_name().items()
            if value is not None
        }

    @classmethod
    def from_dict(cls: type[Self], data: Mapping[str, Any]) -> Self:
        """Return the object that `data`, as from ``to_dict``, describes.

        Parameters
        ----------
        data : mapping
            Arguments of the constructor; missing ones take their defaults, unknown ones are a
            ValueError.

        Examples
        --------
        >>> cloth = cs.Cloth(shape=(4, 5), mass=2.0)
        >>> cs.Cloth.from_dict(cloth.to_dict()) == cloth
        True
        """
        return cls(**cls._check_argument_names(data))

    @classmethod
    def _check_argument_names(cls, data: Mapping[str, Any], *more: str) -> dict[str, Any]:
        """Return `data` as a dict, its keys checked; `more` are keys beside the arguments."""
        arguments = inspect.signature(cls).parameters
        required = [
            name for name, argument in arguments.items() if argument.default is argument.empty
        ]
        return check.mapping(cls.__name__, data, [*more, *arguments], [*more, *required])
