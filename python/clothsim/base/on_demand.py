"""Public names that are imported at their first use, because a simulation does not need them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

_LEFT = {
    **dict.fromkeys(("cotton", "denim"), "examples/light_fabric.py has its figures"),
    "fastest": "python benchmarks/peers --errors, in a clone, finds the fastest runs",
}
"""Names of an earlier version, and what serves instead."""


def on_demand(
    namespace: dict[str, Any], places: Mapping[str, str], also: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of the module with that namespace (PEP 562).

    `places` has the module of each name, relative to the package. `dir` lists `__all__`, the names
    of Python itself and those in `also`.
    """
    package = namespace["__name__"]

    def get(name: str) -> Any:
        if name not in places:
            left = f"; {_LEFT[name]}" if name in _LEFT else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{left}")
        value = namespace[name] = getattr(import_module(places[name], package), name)
        return value

    names = {*namespace["__all__"], *also, *(name for name in namespace if name.startswith("__"))}
    return get, lambda: sorted(names)
