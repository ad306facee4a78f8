"""Argument checks: each returns the value in the form that the package uses, or raises an error that names the argument.

A value of a wrong type is a ``TypeError``, a wrong value a ``ValueError``. A ``bool`` is no number, a NumPy scalar is one.
"""

from __future__ import annotations

import difflib
import math
import numbers
import os
import reprlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, overload

import numpy as np
import numpy.typing as npt

Kind = TypeVar("Kind")
Name = TypeVar("Name", bound=str)

INT64_MAX = 2**63 - 1
"""The largest count that the core can hold."""

MOST_POINTS = 2**31 - 1
"""The most mass points that a grid can have: the core numbers them in 32 bits."""


def no_argument(unknown: Mapping[str, object]) -> None:
    """Refuse keyword arguments that a function does not take; of one that left, name what serves instead."""
    for name in unknown:
        instead = "; kernel='gather' has one set of bits on every instruction set" if name == "strict" else ""
        raise TypeError(f"unknown argument {name!r}{instead}")


def shown(value: Any) -> str:
    """`value` and its type as a short text for an error message."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    return f"{reprlib.repr(value)} ({type(value).__name__})"


def _wrong(name: str, accepted: str, value: Any) -> str:
    return f"{name} must be {accepted}, got {shown(value)}"


def _listed(options: Collection[str]) -> str:
    return ", ".join(map(repr, options)) or "none"


def nearest(value: Any, options: Collection[str]) -> str:
    """A hint at the options that the wrong name `value` may mean; names shorter than four characters have too many."""
    value = str(value)
    close = [one for one in options if len(value) >= 4 and value in one]
    close = close or difflib.get_close_matches(value, options, n=1, cutoff=0.5)
    return f" (did you mean {' or '.join(map(repr, close))}?)" if close else ""


def _range(what: str, minimum: float | None, exclusive: bool, maximum: float | None) -> str:
    bounds = [f"{'>' if exclusive else '>='} {minimum:g}"] if minimum is not None else []
    return " ".join([what, " and ".join([*bounds, *([f"<= {maximum:g}"] if maximum is not None else [])])]).rstrip()


def is_iterable(value: Any) -> bool:
    """Whether `value` can be iterated over; an array without dimensions cannot."""
    return isinstance(value, Iterable) and not (isinstance(value, np.ndarray) and value.ndim == 0)


def instance(name: str, value: Any, kind: type[Kind]) -> Kind:
    """`value` if it is an object of this class."""
    if not isinstance(value, kind):
        raise TypeError(_wrong(name, f"a {kind.__name__}", value))
    return value


def is_number(value: Any) -> bool:
    """Whether `value` is one real number. A 0-d array of a number counts; a bool or a string does not."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def number(
    name: str, value: Any, *, minimum: float | None = None, exclusive: bool = False, maximum: float | None = None
) -> float:
    """`value` as a finite float >= `minimum` (> with `exclusive`) and <= `maximum`."""
    if not is_number(value):
        raise TypeError(_wrong(name, _range("a finite number", minimum, exclusive, maximum), value))
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    low = minimum is not None and (result <= minimum if exclusive else result < minimum)
    if not math.isfinite(result) or low or (maximum is not None and result > maximum):
        raise ValueError(_wrong(name, _range("a finite number", minimum, exclusive, maximum), value))
    return result


def integer(name: str, value: Any, *, minimum: int | None = None, maximum: int = INT64_MAX) -> int:
    """`value` as an int with `minimum` <= value <= `maximum`; 2.0 is no integer."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    low = "" if minimum is None else f" >= {minimum}"
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise TypeError(_wrong(name, f"an integer{low}", value))
    result = int(value)
    if (minimum is not None and result < minimum) or result > maximum:
        high = f"{' and' * bool(low)} <= {maximum}" if result > maximum or maximum != INT64_MAX else ""
        raise ValueError(_wrong(name, f"an integer{low}{high}", value))
    return result


def step_count(duration: float, dt: float) -> None:
    """Raise a ValueError where a run has more steps than the core can count."""
    if not duration / dt <= INT64_MAX:
        raise ValueError(
            f"duration / dt must be at most {INT64_MAX:.3g} steps, got duration = {duration:g} s and dt = {dt:g} s"
        )


def frame_count(name: str, value: float, frames: float) -> None:
    """Raise a ValueError where the argument gives more frames than fit in memory: their times alone take 16 GB."""
    if not frames < 2**31:
        raise ValueError(f"{name} must give fewer than {2**31:,} frames, got {value:g}")


def boolean(name: str, value: Any) -> bool:
    """`value` as a bool; 0 and 1 are none."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(_wrong(name, "True or False", value))
    return bool(value)


def size(name: str, value: Any, accepted: str = "a sequence of finite numbers") -> int:
    """The length of a value, checked to be a sequence or a one-dimensional array."""
    if isinstance(value, (str, bytes)) or not isinstance(value, (Sequence, np.ndarray)):
        raise TypeError(_wrong(name, accepted, value))
    if isinstance(value, np.ndarray) and value.ndim != 1:
        raise ValueError(_wrong(name, accepted, value))
    return len(value)


def items(name: str, value: Any, count: int, what: str) -> list[Any]:
    """The entries of a sequence or one-dimensional array that must have `count` entries."""
    accepted = f"a sequence of {count} {what}"
    if size(name, value, accepted) != count:
        raise ValueError(_wrong(name, accepted, value))
    return list(value)


def shape(value: Any, least: int = 1) -> tuple[int, int]:
    """`value` as (rows, columns) of a grid with at least `least` mass points."""
    given = items("shape", value, 2, "integers (rows, columns)")
    rows, columns = (integer(f"shape[{k}]", n, minimum=1) for k, n in enumerate(given))
    if not least <= rows * columns <= MOST_POINTS:
        bound = "at least two" if rows * columns < least else f"at most {MOST_POINTS:,}"
        raise ValueError(f"shape must have {bound} mass points, got {(rows, columns)}")
    return rows, columns


@overload
def vector(name: str, value: Any) -> tuple[float, float, float]: ...
@overload
def vector(name: str, value: Any, length: Literal[2]) -> tuple[float, float]: ...
def vector(name: str, value: Any, length: int = 3) -> tuple[float, ...]:
    """`value` as a tuple of `length` finite floats."""
    entries = items(name, value, length, "finite numbers")
    return tuple(number(f"{name}[{k}]", entry) for k, entry in enumerate(entries))


def choice(name: str, value: Any, options: Collection[Name]) -> Name:
    """`value` if it is one of the names in `options`."""
    if not isinstance(value, str):
        raise TypeError(_wrong(name, f"one of {_listed(options)}", value))
    for option in options:
        if option == value:
            return option
    raise ValueError(f"{name} must be one of {_listed(options)}, got {value!r}{nearest(value, options)}")


def path(name: str, value: Any, accepted: str = "a path") -> Path:
    """`value` as a path."""
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(_wrong(name, accepted, value))
    if not str(value) or "\0" in str(value):
        raise ValueError(_wrong(name, f"{accepted} without null characters, not empty", value))
    return Path(value)


def folder(name: str, value: Any) -> Path:
    """`value` as the path of a folder that exists or can be made, because no part of the path is a file."""
    where = path(name, value, "the path of a folder")
    there = next((one for one in (where, *where.parents) if one.exists()), where)
    if there.exists() and not there.is_dir():
        raise ValueError(f"{name} must be a folder, got {str(where)!r}: {str(there)!r} is a file")
    return where


def keys(name: str, value: Any, known: Collection[str], required: Collection[str] = ()) -> dict[str, Any]:
    """A plain copy of the mapping `value`, checked to have only keys of `known` and all keys of `required`."""
    if not isinstance(value, Mapping):
        raise TypeError(_wrong(name, f"a mapping with the keys {_listed(known)}", value))
    for key in value:
        if key not in known:
            raise ValueError(f"{name} has the unknown key {key!r}{nearest(key, known)}; accepted: {_listed(known)}")
    if missing := [key for key in required if key not in value]:
        lacks = f"the key{'s' * (len(missing) > 1)} {_listed(missing)}"
        raise ValueError(f"{name} lacks {lacks}; it has {_listed([*value])}, needed: {_listed(required)}")
    return dict(value)


def as_array(name: str, value: Any, accepted: str) -> np.ndarray:
    """`value` as a NumPy array. An error that its own ``__array__`` raises is passed on unchanged."""
    try:
        return np.asarray(value)
    except (ValueError, TypeError) as error:
        if hasattr(value, "__array__"):
            raise
        raise type(error)(_wrong(name, accepted, value)) from error


def array(name: str, value: Any, shape: tuple[int, ...], what: str = "finite numbers") -> npt.NDArray[np.float64]:
    """A C-contiguous float64 copy of `value`, which has exactly `shape` and is finite."""
    accepted = f"an array of shape {shape} of {what}"
    given = as_array(name, value, accepted)
    if given.dtype.kind not in "iuf" and given.size:
        raise TypeError(f"{_wrong(name, accepted, value)} with entries of dtype {given.dtype}")
    if given.shape != shape:
        raise ValueError(f"{name} must be {accepted}, got shape {given.shape}")
    with np.errstate(over="ignore"):  # from a wider float: the next check reports it
        result = np.array(given, dtype=np.float64, order="C")
    check_all(name, result, np.isfinite(result), accepted)
    return result


def check_all(name: str, values: np.ndarray, good: np.ndarray, accepted: str, *, points: bool = False) -> None:
    """Raise a ValueError that names the first entry of `values` where `good` is False.

    `points`: the last three axes are row, column and component, and the mass point is named too.
    """
    if not good.all():
        at = tuple(int(k) for k in np.argwhere(~good)[0])
        where = f"index {at}, mass point {at[-3:-1]}" if points else f"index {at}"
        raise ValueError(f"{name} must be {accepted}, got {float(values[at])!r} at {where}")


def points(name: str, value: Any, shape: tuple[int, int]) -> npt.NDArray[np.float64]:
    """A C-contiguous float64 copy of one vector per mass point of a cloth of `shape`."""
    return array(name, value, (*shape, 3))
