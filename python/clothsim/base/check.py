"""Checks of arguments: each returns the value in the form that the package uses, or raises an error
that names the argument.

A wrong type raises a ``TypeError``, a wrong value a ``ValueError``. A ``bool`` is not a number, a
NumPy scalar is.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import math
import numbers
import os
import reprlib
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast

import numpy as np

from . import Floats

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])
# The likeness of two names, as difflib measures it, from which on a user may have meant the other:
# "cuda" is like "cpu" by 0.57, and "floor" like "force" by 0.6; single slips are from 0.7 on.
_ALIKE = 0.7
INT64_MAX = 2**63 - 1  # the largest count that the core can hold


def value_text(value: Any) -> str:
    """Describe `value` and its type in a short text for an error message."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    return f"{reprlib.repr(value)} ({type(value).__name__})"


def _refuse_value(error: type[Exception], name: str, accepted: str, value: Any) -> NoReturn:
    raise error(f"{name} must be {accepted}, got {value_text(value)}")


SUBSTITUTES: dict[str, str] = {}
"""Arguments that do not exist, and what serves in place of each; the package's `__init__` fills the
table.
"""


def refuse_unknown_arguments(
    owner: str, options: Mapping[str, object], names: Collection[str]
) -> None:
    """Refuse keyword arguments that are not among `names`, and suggest the nearest."""
    for name in options:
        if name not in names:
            hint = _substitute_hint(name, names)
            accepted = ", ".join(map(repr, names)) or "none"
            raise TypeError(
                f"{owner} has the unknown argument {name!r}{hint}; accepted: {accepted}"
            )


def check_names(function: F) -> F:
    """Decorate a function of users: an unknown keyword argument is an error that suggests one."""
    ordered = tuple(name for name in inspect.signature(function).parameters if name != "self")
    names = frozenset(ordered)
    owner = function.__qualname__.removesuffix(".__init__")

    @functools.wraps(function)
    def call_with_known_names(*values: Any, **options: Any) -> Any:
        if not names.issuperset(options):
            refuse_unknown_arguments(owner, options, ordered)
        return function(*values, **options)

    return cast(F, call_with_known_names)


def instance(name: str, value: Any, kind: type[T]) -> T:
    """Return `value` if it is an object of this class."""
    if not isinstance(value, kind):
        _refuse_value(TypeError, name, f"a {kind.__name__}", value)
    return value


def boolean(name: str, value: Any, accepted: str = "True or False") -> bool:
    """Return `value` as a bool; 0 and 1 are refused."""
    if not isinstance(value, (bool, np.bool_)):
        _refuse_value(TypeError, name, accepted, value)
    return bool(value)


def real_or_none(value: Any) -> Any:
    """Return `value` if it is a single real number, also in a 0-d array, else None. A bool is no
    number, nor is the masked entry of an array.
    """
    if value is np.ma.masked:
        return None
    if isinstance(value, (np.ndarray, np.generic)) and value.ndim == 0:
        value = value.item()
    return value if isinstance(value, numbers.Real) and not isinstance(value, bool) else None


def _number_in_range(
    name: str, value: Any, kind: type, accepted: str, low: float, high: float, above: bool = False
) -> Any:
    entry = real_or_none(value)
    good = isinstance(entry, kind)
    # Python compares large integers exactly: 10**400 is too large for a float.
    if (
        good
        and low <= entry <= high
        and abs(entry) <= sys.float_info.max
        and not (above and entry == low)
    ):
        return entry
    bounds = []
    if low > -math.inf:
        bounds.append(f" {'>' if above else '>='} {low:.12g}")
    if high < INT64_MAX or (good and entry > high):
        bounds.append(f" <= {high:.12g}")
    _refuse_value(ValueError if good else TypeError, name, accepted + " and".join(bounds), value)


def number(
    name: str,
    value: Any,
    *,
    minimum: float = -math.inf,
    exclusive: bool = False,
    maximum: float = math.inf,
) -> float:
    """Return `value` as a finite float >= `minimum` (> with `exclusive`) and <= `maximum`."""
    if type(value) is float and minimum < value < maximum:
        return value
    return float(
        _number_in_range(name, value, numbers.Real, "a finite number", minimum, maximum, exclusive)
    )


def integer(name: str, value: Any, *, minimum: float = -math.inf, maximum: int = INT64_MAX) -> int:
    """Return `value` as an int with `minimum` <= value <= `maximum`; 2.0 is not an integer."""
    if type(value) is int and minimum <= value <= maximum:
        return value
    return int(_number_in_range(name, value, numbers.Integral, "an integer", minimum, maximum))


def list_of_items(name: str, value: Any, count: int | None, kind: str, least: int = 0) -> list[Any]:
    """List the entries of a sequence or one-dimensional array: `count` of them, or at least
    `least`.
    """
    if count is not None:
        number = f"{count} "
    elif least:
        number = f"at least {least} "
    else:
        number = ""
    accepted = f"a sequence of {number}{kind}"
    if isinstance(value, (str, bytes)) or not isinstance(value, (Sequence, np.ndarray)):
        _refuse_value(TypeError, name, accepted, value)
    listed = list(value) if not isinstance(value, np.ndarray) or value.ndim == 1 else []
    if len(listed) < least or count not in (None, len(listed)):
        _refuse_value(ValueError, name, accepted, value)
    return listed


def vector(name: str, value: Any, length: int = 3) -> Any:
    """Return `value` as a tuple of `length` finite floats."""
    entries = list_of_items(name, value, length, "finite numbers")
    return tuple(number(f"{name}[{k}]", entry) for k, entry in enumerate(entries))


def check_step_count(duration: float, dt: float) -> None:
    """Refuse a run of more steps than the core can count."""
    if not duration / dt <= INT64_MAX:
        raise ValueError(
            f"duration / dt must be at most {INT64_MAX:.3g} steps, got {duration:g} s / {dt:g} s"
        )


def choice(name: str, value: Any, options: Collection[T]) -> T:
    """Return `value` if it is one of the names in `options`; the error suggests the nearest."""
    if isinstance(value, str) and value in options:
        return value  # type: ignore[return-value]  # names are texts
    accepted = f"one of {', '.join(map(repr, options))}"
    if not isinstance(value, str):
        _refuse_value(TypeError, name, accepted, value)
    raise ValueError(f"{name} must be {accepted}, got {value!r}{nearest_name_hint(value, options)}")


def nearest_name_hint(value: Any, options: Collection[Any]) -> str:
    """Hint at the option that the wrong name `value` may mean."""
    close = difflib.get_close_matches(str(value), options, n=1, cutoff=_ALIKE)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _substitute_hint(name: str, options: Collection[str]) -> str:
    """Hint at what serves in place of the unknown argument `name`."""
    return f"; {SUBSTITUTES[name]}" if name in SUBSTITUTES else nearest_name_hint(name, options)


def mapping(
    name: str, value: Any, names: Collection[str], required: Collection[str] = ()
) -> dict[str, Any]:
    """Copy the mapping `value`, after a check that it has only keys of `names` and all keys of
    `required`.
    """
    accepted = ", ".join(map(repr, names)) or "none"
    if not isinstance(value, Mapping):
        _refuse_value(TypeError, name, f"a mapping with the keys {accepted}", value)
    for key in value:
        if key not in names:
            hint = _substitute_hint(key, names)
            raise ValueError(f"{name} has the unknown key {key!r}{hint}; accepted: {accepted}")
    for key in required:
        if key not in value:
            needed = ", ".join(map(repr, required))
            raise ValueError(f"{name} lacks the key {key!r}; needed: {needed}")
    return dict(value)


def path(name: str, value: Any, accepted: str = "a path") -> Path:
    """Return `value` as a path."""
    if not isinstance(value, (str, os.PathLike)):
        _refuse_value(TypeError, name, accepted, value)
    if not str(value) or "\0" in str(value):
        _refuse_value(ValueError, name, accepted, value)
    return Path(value)


def as_array(name: str, value: Any, accepted: str, kinds: str = "iuf") -> np.ndarray:
    """Return `value` as a NumPy array of real numbers, or of other `kinds` of dtypes."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        number = int(np.ma.getmaskarray(value).sum())
        raise ValueError(
            f"{name} must be {accepted}, got an array with {number} masked entries: fill them"
        )
    try:
        entries = np.asarray(value)
    except (ValueError, TypeError):  # as of rows of different lengths
        _refuse_value(TypeError, name, accepted, value)
    if entries.dtype.kind not in kinds and entries.size:
        _refuse_value(TypeError, name, accepted, value)
    return entries


def array(
    name: str, value: Any, shape: tuple[int, ...] | None = None, kind: str = "finite numbers"
) -> Floats:
    """Copy `value` to a C-contiguous float64 array, after a check that it is finite and, unless
    `shape` is None, of that shape.
    """
    accepted = kind if shape is None else f"an array of shape {shape} of {kind}"
    entries = as_array(name, value, accepted)
    if shape is not None and entries.shape != shape:
        raise ValueError(f"{name} must be {accepted}, got shape {entries.shape}")
    result = np.array(entries, dtype=np.float64, order="C")
    check_all(name, result, np.isfinite(result), accepted)
    return result


def check_all(
    name: str, values: np.ndarray, good: np.ndarray, accepted: str, *, points: bool = False
) -> None:
    """Refuse the first entry of `values` where `good` is False; `points`: its axes end with row,
    column and component.
    """
    if not good.all():
        index = tuple(int(k) for k in np.argwhere(~good)[0])
        place = f" at index {index}" if index else ""
        if points:
            place += f", mass point {index[-3:-1]}"
        raise ValueError(f"{name} must be {accepted}, got {float(values[index])!r}{place}")
