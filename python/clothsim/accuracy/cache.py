"""Solutions kept in memory and on disk, so that a trusted solution is computed once.

Readers see a whole file or none. Several processes may write one file, also in a shared folder: the last writer wins,
and all write equal content. A damaged file is computed again and replaced.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
import warnings
from collections import OrderedDict
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..base import files

ENVIRONMENT_VARIABLE = "CLOTHSIM_CACHE_DIR"
_IN_MEMORY = 32  # solutions

_memory: OrderedDict[str, dict[str, np.ndarray]] = OrderedDict()
_lock = threading.Lock()


def cache_directory() -> Path:
    """The folder in which `reference` keeps its solutions.

    Returns
    -------
    pathlib.Path
        The environment variable CLOTHSIM_CACHE_DIR if it is set, else "clothsim" in the user's
        cache folder: XDG_CACHE_HOME or ~/.cache, ~/Library/Caches on macOS, LOCALAPPDATA on
        Windows. The first solution that is kept makes the folder. You may delete it at any time.

    Examples
    --------
    >>> from clothsim.accuracy import cache_directory
    >>> cache_directory().is_absolute()
    True
    """
    if chosen := os.environ.get(ENVIRONMENT_VARIABLE):
        return Path(chosen).absolute()
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        given = Path(os.environ.get("XDG_CACHE_HOME", ""))
        base = given if given.is_absolute() else Path.home() / ".cache"
    return base / "clothsim"


MODULES = (
    "model/as_core.py",
    "model/cloth.py",
    "model/scene.py",
    "engine/plan.py",
    "accuracy/in_double.py",
    "accuracy/solution.py",
)
"""Modules that describe a cloth to the core, or compute with it."""


@cache
def code() -> str:
    """A hash of the code that computes a solution: the built core and the modules that pass a cloth to it.

    The version number does not suffice: it stays equal while a developer changes the code.
    """
    package = Path(__file__).parent.parent
    modules = (package / name for name in MODULES)
    found = hashlib.sha256()
    for path in (Path(_core.__file__), *modules):
        found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()


def key_of(facts: Mapping[str, Any]) -> str:
    """The key of a solution: a hash of `facts` (plain data)."""
    text = json.dumps(facts, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _path(key: str) -> Path:
    return cache_directory() / "references" / f"{key}.npz"


def load(key: str) -> tuple[dict[str, np.ndarray], str] | None:
    """The arrays kept under `key` and their place, "memory" or "disk"; None if there are none."""
    with _lock:
        if key in _memory:
            _memory.move_to_end(key)
            return _memory[key], "memory"
    try:
        arrays = files.read_npz(_path(key), "reference solution", ("key",))
    except (OSError, ValueError):
        return None
    if str(arrays.pop("key")) != key:
        return None
    return _keep(key, arrays), "disk"


def _keep(key: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    for array in arrays.values():
        array.flags.writeable = False
    with _lock:
        _memory[key] = arrays
        _memory.move_to_end(key)
        while len(_memory) > _IN_MEMORY:
            _memory.popitem(last=False)
    return arrays


def save(key: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Keep `arrays` under `key` in memory and on disk, and make the arrays read-only."""
    path = _path(key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_npz(path, {"key": np.array(key), **arrays})
    except (OSError, ValueError) as error:  # ValueError: a folder in its place
        warnings.warn(
            f"the reference solution is kept in memory only: {error} ({ENVIRONMENT_VARIABLE} names another folder)",
            RuntimeWarning,
            stacklevel=4,
        )
    return _keep(key, arrays)


def forget() -> None:
    """Forget the solutions in memory."""
    with _lock:
        _memory.clear()
