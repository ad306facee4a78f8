"""Packages beyond NumPy, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def needed(name: str, what: str, extra: str = "sweep") -> Any:
    """The module of that name, or an ImportError: which extra brings it, or why it cannot be loaded."""
    try:
        module = import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == package:
            raise ImportError(f"{what} needs {package}: run pip install 'clothsim[{extra}]'") from error
        # An installed package may lack memory, or a package of its own.
        raise ImportError(f"{what} needs {package}, which is installed but could not be loaded: {error}") from error
    if name == "xarray":
        from ..sweeps import accessor  # noqa: F401  # registers `Dataset.clothsim`
    return module
