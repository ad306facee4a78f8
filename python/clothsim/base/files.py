"""Files of this package: NumPy archives (.npz) without pickle, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from . import check


def npz_path(path: str | os.PathLike[str], name: str = "path") -> Path:
    """`path` as the path of a .npz file; the ending is added where there is none."""
    found = check.path(name, path)
    if found.suffix == ".npz":
        return found
    if found.suffix:
        raise ValueError(
            f"{name} must end in .npz or have no ending, got {str(found)!r}; the file is a NumPy "
            "archive, which readers of other formats cannot open"
        )
    return found.with_name(found.name + ".npz")


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays and texts to a temporary file beside `path`, then rename the complete file to `path`."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder, got {str(path)!r}")
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(part, "wb") as file:
            np.savez_compressed(file, **arrays)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def read_npz(path: str | os.PathLike[str], what: str, needed: Collection[str]) -> dict[str, np.ndarray]:
    """The arrays of a file that `write_npz` wrote, or a ValueError that says it is no `what`."""
    from zipfile import BadZipFile  # takes longer than the rest of this module

    path = check.path("path", path)
    try:
        data = np.load(path, allow_pickle=False)
        if isinstance(data, np.ndarray):
            raise ValueError("it holds a single array")
        with data:
            missing = sorted(set(needed) - set(data.files))
            if missing:
                raise ValueError(f"it lacks {', '.join(missing)}")
            return {name: data[name] for name in data.files}
    except (ValueError, EOFError, KeyError, BadZipFile) as error:
        # NumPy takes any other file for a pickle.
        reason = "it is no NumPy archive" if "pickle" in str(error) else error
        raise ValueError(f"{path} is no {what} of clothsim: {reason}") from None
