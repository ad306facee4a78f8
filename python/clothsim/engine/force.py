"""The argument `force` of functions that step: a function of the user as a force of the core."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .. import _core
from ..base import Floats, check
from ..model.scene import Scene
from ..typing import Force

ACCEPTED = "a function f(t, x, v), a scipy.LowLevelCallable or a numba cfunc"
SIGNATURE = (
    "void (double t, const double *x, const double *v, double *f, int64_t points), with a last "
    "argument void * where it has user data"
)
_POINTER = "double *"
_ARGUMENTS = ["double", _POINTER, _POINTER, _POINTER, "int64_t"]
# What C and ctypes call an integer of 64 bits here.
_INTEGERS = {
    *("int64_t", "int64", "long", "long long", "longlong"),
    *("npy_intp", "Py_ssize_t", "intptr_t"),
}
_TYPES = {"void", "double", "char", "short", "int", "float", "unsigned", *_INTEGERS}


@dataclass(frozen=True)
class Held:
    """A force at one time [s], whatever the time of the state."""

    function: Any
    t: float


def checked_force(force: Any, argument: str = "force") -> Force | None:
    """Return `force` if the core can call it; else raise an error."""
    if force is None or isinstance(force, Held) or _native(force, argument) or callable(force):
        return force
    raise TypeError(f"{argument} must be {ACCEPTED}, or None, got {check.shown(force)}")


def forces_of(force: Any, scenes: Sequence[Scene], several: bool) -> list[Force | None]:
    """Return the force of each scene; an empty list without a force.

    `force` acts on all scenes. If they are `several`, it may also be a list with a force for each.
    """
    if force is None:
        return []
    if not several or not isinstance(force, list):
        return [checked_force(force)] * len(scenes)
    if len(force) != len(scenes):
        raise ValueError(
            f"force must be one function, or a list of {len(scenes)} for as many scenes, got "
            f"{len(force)}"
        )
    return [checked_force(one, f"force[{k}]") for k, one in enumerate(force)]


def is_python(force: Force | None) -> bool:
    """Tell whether only one thread at a time may call the force."""
    return force is not None and _native(force) is None


def with_force(plan: _core.Plan, force: Any, shape: tuple[int, int]) -> _core.Plan:
    """Add a user's force to a plan."""
    if force is None:
        return plan
    held: float | None = None
    if isinstance(force, Held):
        held, force = force.t, force.function
    if native := _native(force):
        return plan.with_c_force(*native, force, held)
    full = (*shape, 3)

    def checked(t: float, x: Floats, v: Floats) -> Floats:
        result = force(t if held is None else held, x, v)
        return check.array("the result of force(t, x, v)", result, full)

    return plan.with_python_force(checked)


def _native(force: Any, argument: str = "force") -> tuple[int, int | None] | None:
    """Return the addresses of a C function and of its user data; None for a Python function."""
    kind = type(force)
    if kind.__name__ == "LowLevelCallable" and kind.__module__.startswith("scipy."):
        # The entry of the tuple itself; the class hides it.
        signature, address, data = _core.capsule_facts(tuple.__getitem__(force, 0))
        known = parsed(signature)
    elif kind.__name__ == "CFunc" and kind.__module__.startswith("numba."):
        from_numba = force.ctypes
        names = [_ctypes_name(one) for one in (from_numba.restype, *from_numba.argtypes)]
        signature, address, data = f"{names[0]} ({', '.join(names[1:])})", force.address, 0
        known = parsed(signature)
    else:
        return None
    takes_data = known == ["void", *_ARGUMENTS, "void *"]
    if not (takes_data or known == ["void", *_ARGUMENTS]):
        raise ValueError(f"{argument} must have the signature {SIGNATURE}, got {signature!r}")
    return address, data if takes_data else None


def _ctypes_name(kind: Any) -> str:
    if kind is None:
        return "void"
    name = str(kind.__name__)
    pointers = name.count("LP_")
    return name.replace("LP_", "").removeprefix("c_") + " " + "*" * pointers


def parsed(signature: str) -> list[str]:
    """Return the types in a C signature, that of the result first.

    `const` and the names of arguments are dropped, and integers of 64 bits are called int64_t.

    >>> parsed("void(double t, const double *x, long n)")
    ['void', 'double', 'double *', 'int64_t']
    """
    result, _, rest = signature.partition("(")
    found = []
    for one in [result, *rest.rstrip(" )").split(",")]:
        words = [word for word in re.findall(r"\w+", one) if word != "const"]
        if len(words) > 1 and words[-1] not in _TYPES:
            words.pop()  # the name of the argument
        name = " ".join(words)
        name = "int64_t" if name in _INTEGERS and "*" not in one else name
        found.append(f"{name} {'*' * one.count('*')}".strip())
    return found
