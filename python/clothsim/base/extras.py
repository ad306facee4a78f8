"""Packages beyond NumPy, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any


def how_to_install(extra: str) -> str:
    """The command that installs an extra into the environment in which clothsim is installed already."""
    return f"run pip install 'clothsim[{extra}]'"


def needed(name: str, what: str, extra: str = "sweep") -> Any:
    """The module of that name, or an ImportError: which extra brings it, or why it cannot be loaded."""
    try:
        module = import_module(name)
    except ImportError as error:
        raise ImportError(reason_of(error, name, what, extra)) from error
    if name == "xarray":
        from ..sweeps import accessor  # noqa: F401  # registers `Dataset.clothsim`
    return module


def reason_of(error: ImportError | None, name: str, what: str, extra: str) -> str:
    """The message for a package that could not be imported. An installed package may lack memory or a package of its own."""
    package = name.partition(".")[0]
    if error is None or (isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == package):
        return f"{what} needs {package}: {how_to_install(extra)}"
    return f"{what} needs {package}, which is installed but could not be loaded: {error}"


def check_installed(name: str, what: str, extra: str = "sweep") -> None:
    """Raise the ImportError of `needed` before any work is done, without importing the package."""
    if find_spec(name.partition(".")[0]) is None:
        raise ImportError(reason_of(None, name, what, extra))
