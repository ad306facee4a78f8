"""Functions of later rooms that objects of earlier rooms offer as methods.

A scene shows itself in a notebook and a run draws itself, but a later room makes the pictures. A room
imports only from earlier rooms. So the front door, `clothsim/__init__.py`, says here where each such
function is, and its first call imports the module.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

_places: dict[str, str] = {}


def provide(places: Mapping[str, str]) -> None:
    """Say where functions are: "module:function" of each name."""
    _places.update(places)


def later(name: str) -> Callable[..., Any]:
    """The function that the front door has provided under a name."""
    module, _, function = _places[name].partition(":")
    found: Callable[..., Any] = getattr(import_module(module), function)
    return found


def module_of(name: str) -> ModuleType:
    """The module of that full name, imported now: of a command, or of a format of files."""
    return import_module(name)
