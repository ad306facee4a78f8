"""Functions of later rooms of the package that objects of earlier rooms offer as methods.

A room is a folder of the package, and imports only from earlier rooms. A scene shows itself in a notebook and a run
draws itself, but a later room makes the pictures. `clothsim/__init__.py` therefore registers the place of each such
function here. The first call of the function imports its module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

_places: dict[str, str] = {}


def provide(places: Mapping[str, str]) -> None:
    """Register the places of functions: a name, and its "module:function"."""
    _places.update(places)


def later(name: str) -> Callable[..., Any]:
    """The function that `provide` registered under a name."""
    module, _, function = _places[name].partition(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found


def module_of(name: str) -> ModuleType:
    """Import the module with this full name, which implements a command or a file format."""
    return import_module(name)
