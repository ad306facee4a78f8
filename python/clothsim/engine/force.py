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

_KINDS = "a function f(t, x, v), a scipy.LowLevelCallable or a numba cfunc"
SIGNATURE = (
    "void (double t, const double *x, const double *v, double *f, int64_t points), with a last "
    "argument void * where it has user data"
)
_POINTER = "double *"
_ARGUMENTS = ["double", _POINTER, _POINTER, _POINTER, "int64_t"]
# C and ctypes give these names to an integer of 64 bits here.
_INTEGERS = {
    *("int64_t", "int64", "long", "long long", "longlong"),
    *("npy_intp", "Py_ssize_t", "intptr_t"),
}
_TYPES = {"void", "double", "char", "short", "int", "float", "unsigned", *_INTEGERS}


@dataclass(frozen=True)
class ForceAtTime:
    """A force at one time [s], whatever the time of the state."""

    function: Any
    t: float


def check_force(force: Any, argument: str = "force") -> Force | None:
    """Return `force` if the core can call it; else raise an error."""
    if (
        force is None
        or isinstance(force, ForceAtTime)
        or _c_addresses(force, argument)
        or callable(force)
    ):
        return force
    raise TypeError(f"{argument} must be {_KINDS}, or None, got {check.value_text(force)}")


def force_of_each_scene(force: Any, scenes: Sequence[Scene], batched: bool) -> list[Force | None]:
    """Return the force of each scene; an empty list without a force.

    `force` acts on all scenes. It may also be a list with a force for each scene of a batch.
    """
    if force is None:
        return []
    if not batched or not isinstance(force, list):
        return [check_force(force)] * len(scenes)
    if len(force) != len(scenes):
        raise ValueError(
            f"force must be one function, or a list of {len(scenes)} for as many scenes, got "
            f"{len(force)}"
        )
    return [check_force(member, f"force[{k}]") for k, member in enumerate(force)]


def needs_python(force: Force | None) -> bool:
    """Tell whether only one thread at a time may call the force."""
    return force is not None and _c_addresses(force) is None


def plan_with_force(plan: _core.Plan, force: Any, shape: tuple[int, int]) -> _core.Plan:
    """Add a user's force to a plan."""
    if force is None:
        return plan
    fixed_t: float | None = None
    if isinstance(force, ForceAtTime):
        fixed_t = force.t
        force = force.function
    if addresses := _c_addresses(force):
        return plan.with_c_force(*addresses, force, fixed_t)

    def call_force(t: float, x: Floats, v: Floats) -> Floats:
        result = force(t if fixed_t is None else fixed_t, x, v)
        return check.array("the result of force(t, x, v)", result, (*shape, 3))

    return plan.with_python_force(call_force)


def _c_addresses(force: Any, argument: str = "force") -> tuple[int, int | None] | None:
    """Return the addresses of a C function and of its user data; None for a Python function."""
    kind = type(force)
    if kind.__name__ == "LowLevelCallable" and kind.__module__.startswith("scipy."):
        # The class hides the entry of the tuple itself.
        signature, address, data = _core.capsule_facts(tuple.__getitem__(force, 0))
    elif kind.__name__ == "CFunc" and kind.__module__.startswith("numba."):
        from_numba = force.ctypes
        result = _c_type_name(from_numba.restype)
        arguments = ", ".join(map(_c_type_name, from_numba.argtypes))
        signature = f"{result} ({arguments})"
        address = force.address
        data = 0
    else:
        return None
    types = types_in_signature(signature)
    takes_data = types == ["void", *_ARGUMENTS, "void *"]
    if not (takes_data or types == ["void", *_ARGUMENTS]):
        raise ValueError(f"{argument} must have the signature {SIGNATURE}, got {signature!r}")
    return address, data if takes_data else None


def _c_type_name(kind: Any) -> str:
    if kind is None:
        return "void"
    name = str(kind.__name__)
    pointers = name.count("LP_")
    return name.replace("LP_", "").removeprefix("c_") + " " + "*" * pointers


def types_in_signature(signature: str) -> list[str]:
    """Return the types in a C signature, that of the result first.

    `const` and the names of arguments are dropped, and integers of 64 bits are called int64_t.

    >>> types_in_signature("void(double t, const double *x, long n)")
    ['void', 'double', 'double *', 'int64_t']
    """
    result, _, arguments = signature.partition("(")
    types = []
    for text in [result, *arguments.rstrip(" )").split(",")]:
        words = [word for word in re.findall(r"\w+", text) if word != "const"]
        if len(words) > 1 and words[-1] not in _TYPES:
            words.pop()  # the name of the argument
        name = " ".join(words)
        if name in _INTEGERS and "*" not in text:
            name = "int64_t"
        types.append(f"{name} {'*' * text.count('*')}".strip())
    return types
