"""Packages beyond NumPy, imported when they are needed."""

from __future__ import annotations

import importlib
from typing import Any


def needed(name: str, what: str, extra: str = "sweep") -> Any:
    """The module of that name, or an ImportError that tells which extra brings it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ImportError(f"{what} needs {package}: pip install 'clothsim[{extra}]'") from error
