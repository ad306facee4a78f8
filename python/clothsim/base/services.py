"""Functions of later rooms that earlier rooms call, such as the drawing behind `Run.picture`.

A room imports only from earlier rooms (docs/dev/rooms.md). A method that a later room serves asks
for its function here by name, and the module is imported at the first call. The package's
`__init__` says which module has which function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

_MODULES: dict[str, str] = {}


def register_services(modules: Mapping[str, Sequence[str]]) -> None:
    """Add functions (or classes), given as the full name of a module -> names in it."""
    for module, names in modules.items():
        _MODULES.update(dict.fromkeys(names, module))


def find_service(name: str) -> Callable[..., Any]:
    """Return the function that was registered under this name."""
    function: Callable[..., Any] = getattr(import_module(_MODULES[name]), name)
    return function
