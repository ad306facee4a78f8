"""Argument checks shared by all modules.

Each check returns the value in the form that the package uses, or raises an error. The error names the argument, the
accepted values and the given value. An object of a wrong type gives a ``TypeError``, a wrong value a ``ValueError``. A
``bool`` does not count as a number, and a NumPy scalar does.
"""

from __future__ import annotations

import difflib
import math
import numbers
import os
import reprlib
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, overload

import numpy as np
import numpy.typing as npt

Kind = TypeVar("Kind")
Name = TypeVar("Name", bound=str)

INT64_MAX = 2**63 - 1
"""The largest count that the core can hold."""


def shown(value: Any) -> str:
    """`value` and its type as a short text for an error message."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    try:
        text = reprlib.repr(value)
    except ValueError:  # an int of more digits than Python prints
        text = "a number of thousands of digits"
    return f"{text} ({type(value).__name__})"


def _failed(name: str, accepted: str, value: Any, error: Exception) -> Exception:
    """The error to raise if the conversion of a value raised `error`."""
    kind = ValueError if isinstance(error, ValueError) else TypeError
    return kind(f"{_wrong(name, accepted, value)}: {type(error).__name__}: {error}")


def _wrong(name: str, accepted: str, value: Any) -> str:
    return f"{name} must be {accepted}, got {shown(value)}"


def _listed(options: Collection[str]) -> str:
    return ", ".join(repr(option) for option in options) or "none"


_LEAST_PART = 4  # characters of a name that suggest it; with fewer, too many names have them


def _nearest(value: Any, options: Collection[str]) -> str:
    value = str(value)
    close = [one for one in options if len(value) >= _LEAST_PART and value in one]
    close = close or difflib.get_close_matches(value, options, n=1, cutoff=0.5)
    return f" (did you mean {' or '.join(map(repr, close))}?)" if close else ""


def _range(minimum: float | None, exclusive: bool, maximum: float | None) -> str:
    low = "" if minimum is None else f" {'>' if exclusive else '>='} {minimum:g}"
    high = "" if maximum is None else f" <= {maximum:g}"
    return f"{low}{' and' if low and high else ''}{high}"


def is_iterable(value: Any) -> bool:
    """Whether `value` can be iterated over; an array without dimensions cannot."""
    return isinstance(value, Iterable) and not (isinstance(value, np.ndarray) and value.ndim == 0)


def is_masked(value: Any) -> bool:
    """Whether `value` is a masked array or the constant ``numpy.ma.masked``."""
    # No masked array exists before numpy.ma is imported. Another thread may be importing it now.
    masked = getattr(sys.modules.get("numpy.ma"), "MaskedArray", None)
    return masked is not None and isinstance(value, masked)


def instance(name: str, value: Any, kind: type[Kind]) -> Kind:
    """`value` if it is an object of this class."""
    if not isinstance(value, kind):
        raise TypeError(_wrong(name, f"a {kind.__name__}", value))
    return value


def is_number(value: Any) -> bool:
    """Whether `value` is one real number. A 0-d array of a number counts; a bool or a string does not."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]  # of numpy.ma.masked it is that again, and no number
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def number(
    name: str, value: Any, *, minimum: float | None = None, exclusive: bool = False, maximum: float | None = None
) -> float:
    """`value` as a finite float >= `minimum` (> with `exclusive`) and <= `maximum`."""
    if not is_number(value):
        accepted = f"a finite number{_range(minimum, exclusive, maximum)}"
        raise TypeError(_wrong(name, accepted, value))
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    except Exception as error:
        accepted = f"a finite number{_range(minimum, exclusive, maximum)}"
        raise _failed(name, accepted, value, error) from error
    too_low = minimum is not None and (result <= minimum if exclusive else result < minimum)
    too_high = maximum is not None and result > maximum
    if not math.isfinite(result) or too_low or too_high:
        accepted = f"a finite number{_range(minimum, exclusive, maximum)}"
        raise ValueError(_wrong(name, accepted, value))
    return result


def integer(name: str, value: Any, *, minimum: int | None = None, maximum: int = INT64_MAX) -> int:
    """`value` as an int with `minimum` <= value <= `maximum`; 2.0 is no integer."""
    low = "" if minimum is None else f" >= {minimum}"
    # The largest that the core holds goes without saying, unless it is what was passed.
    high = f" <= {maximum}" if maximum != INT64_MAX else ""
    accepted = f"an integer{low}{' and' if low and high else ''}{high}"
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise TypeError(_wrong(name, accepted, value))
    try:
        result = int(value)
    except Exception as error:
        raise _failed(name, accepted, value, error) from error
    if (minimum is not None and result < minimum) or result > maximum:
        if result > maximum and not high:
            accepted = f"an integer{low}{' and' * bool(low)} <= {maximum}"
        raise ValueError(_wrong(name, accepted, value))
    return result


def step_count(duration: float, dt: float) -> None:
    """Raise a ValueError where a run has more steps than the core can count."""
    if not duration / dt <= INT64_MAX:
        raise ValueError(
            f"duration / dt must be at most {INT64_MAX:.3g} steps, got duration = {duration:g} s and dt = {dt:g} s"
        )


MOST_FRAMES = 2**31 - 1
"""The most frames of a run; the memory for their times alone is 16 GB."""


def frame_count(duration: float, every: float) -> None:
    """Raise a ValueError where `every`, in seconds, gives more frames than fit in memory."""
    if not duration / every <= MOST_FRAMES:
        raise ValueError(
            f"every must be at least {duration / MOST_FRAMES:.3g} s, so that a run of duration = "
            f"{duration:g} s has at most {MOST_FRAMES:,} frames, got {every:g}"
        )


def boolean(name: str, value: Any) -> bool:
    """`value` as a bool; 0 and 1 are none."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(_wrong(name, "True or False", value))
    return bool(value)


def size(name: str, value: Any, accepted: str = "a sequence of finite numbers") -> int:
    """The length of a value, checked to be a sequence or a one-dimensional array."""
    if isinstance(value, (str, bytes)) or not isinstance(value, (Sequence, np.ndarray)):
        raise TypeError(_wrong(name, accepted, value))
    if is_masked(value):
        as_array(name, value, accepted)
    if isinstance(value, np.ndarray) and value.ndim != 1:
        raise ValueError(_wrong(name, accepted, value))
    return len(value)


def items(name: str, value: Any, count: int, what: str) -> list[Any]:
    """The entries of a sequence or one-dimensional array that must have `count` entries."""
    accepted = f"a sequence of {count} {what}"
    if size(name, value, accepted) != count:
        raise ValueError(_wrong(name, accepted, value))
    return list(value)


MOST_POINTS = 2**31 - 1
"""The most mass points that a grid can have: the core numbers them in 32 bits."""


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
    if isinstance(value, str):
        for option in options:
            if option == value:
                return option
    accepted = f"one of {_listed(options)}"
    if not isinstance(value, str):
        raise TypeError(_wrong(name, accepted, value))
    raise ValueError(f"{name} must be {accepted}, got {value!r}{_nearest(value, options)}")


def text(name: str, value: Any) -> str:
    """`value`, a str that UTF-8 can hold."""
    if not isinstance(value, str):
        raise TypeError(_wrong(name, "a text", value))
    if any("\ud800" <= character <= "\udfff" for character in value):
        raise ValueError(_wrong(name, "a text without lone surrogates, which no file can hold", value))
    return value


def path(name: str, value: Any, accepted: str = "a path") -> Path:
    """`value` as a path: a str, or an object that `os.fspath` turns into a str."""
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(_wrong(name, accepted, value))
    try:
        text = os.fspath(value)
    except Exception as error:
        raise _failed(name, accepted, value, error) from error
    if not isinstance(text, str):
        raise TypeError(_wrong(name, f"{accepted} that is a str", value))
    if "\0" in text or not text:
        raise ValueError(_wrong(name, f"{accepted} without null characters, not empty", value))
    return Path(text)


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
            raise ValueError(f"{name} has the unknown key {key!r}{_nearest(key, known)}; accepted: {_listed(known)}")
    missing = [key for key in required if key not in value]
    if missing:
        lacks = f"the key{'s' * (len(missing) > 1)} {_listed(missing)}"
        raise ValueError(f"{name} lacks {lacks}; it has {_listed([*value])}, needed: {_listed(required)}")
    return dict(value)


def as_array(name: str, value: Any, accepted: str) -> np.ndarray:
    """`value` as a NumPy array. An error that its own ``__array__`` raises is passed on unchanged.

    A masked array is refused: NumPy would drop the mask, and masked entries would count.
    """
    if is_masked(value) or (isinstance(value, (list, tuple)) and any(map(is_masked, value))):
        raise TypeError(
            f"{name} must be {accepted}, got a masked array, whose mask would be lost; "
            "pass its .filled(value), or .data if nothing is masked"
        )
    try:
        return np.asarray(value)
    except Exception as error:
        if hasattr(value, "__array__"):
            raise
        if isinstance(error, ValueError):
            raise ValueError(f"{name} must be {accepted}, got rows of different lengths") from None
        raise _failed(name, accepted, value, error) from error


def array(name: str, value: Any, shape: tuple[int, ...], what: str = "finite numbers") -> npt.NDArray[np.float64]:
    """A C-contiguous float64 copy of `value`, which has exactly `shape` and is finite."""
    accepted = f"an array of shape {shape} of {what}"
    given = as_array(name, value, accepted)
    if given.dtype.kind not in "iuf" and given.size:
        of = "" if isinstance(value, np.ndarray) or not given.ndim else f" with entries of dtype {given.dtype}"
        raise TypeError(_wrong(name, accepted, value) + of)
    if given.shape != shape:
        raise ValueError(f"{name} must be {accepted}, got shape {given.shape}")
    # Overflow on the way from a wider float gives inf, which the next check reports.
    with np.errstate(over="ignore"):
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
    """A C-contiguous float64 copy of one vector per mass point.

    `shape` is the cloth's (rows, columns); `value` has shape (rows, columns, 3) and is finite.
    """
    return array(name, value, (*shape, 3))
