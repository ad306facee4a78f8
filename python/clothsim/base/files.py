"""Files that the package writes: whole or not at all; NumPy archives (.npz) without pickle; and one
form of JSON.

A file is written in a new folder beside its target, forced to the disk, and then renamed to its
target. A full disk or a kill leaves the old file as it was.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from . import check


@contextmanager
def temporary_folder_beside(path: Path) -> Iterator[Path]:
    """Make a folder beside `path` for files that `move_files` moves to their places, and remove it
    at the end.
    """
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder, got {str(path)!r}")
    if path.exists() and not path.is_file():
        raise ValueError(
            f"path must be a file, or not exist yet, got {str(path)!r}, which is a folder or device"
        )
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(
            f"path must be a file that may be written, got {str(path)!r}, which is read-only"
        )
    try:
        with TemporaryDirectory(prefix=".clothsim-", dir=path.parent) as folder:
            yield Path(folder)
    except OSError as error:
        if error.errno:
            error.filename = str(path)  # the user does not know the folder's name
            del error.filename2  # None would be shown as " -> None".
        raise


def move_files(files: Sequence[Path], folder: Path) -> list[Path]:
    """Move complete files to `folder`, the first one last; a symbolic link there is replaced, not
    followed.
    """
    places = [folder / file.name for file in files]
    for file, place in reversed(list(zip(files, places))):
        with open(file, "r+b") as stream:
            os.fsync(stream.fileno())
        if place.is_file() and not place.is_symlink():
            shutil.copymode(place, file)
        os.replace(file, place)
    return places


@contextmanager
def replace_when_complete(path: Path) -> Iterator[Path]:
    """Make a file to write, which replaces `path` at the end of the block, unless it raises."""
    with temporary_folder_beside(path) as folder:
        yield folder / path.name
        move_files([folder / path.name], path.parent)


def write_bytes(path: Path, data: bytes) -> Path:
    """Write a file, whole or not at all."""
    with replace_when_complete(path) as part:
        part.write_bytes(data)
    return path


def npz_path(path: str | os.PathLike[str], name: str = "path") -> Path:
    """Return `path` as the path of a .npz file; the ending is added where there is none."""
    file = check.path(name, path)
    if file.suffix not in ("", ".npz"):
        raise ValueError(
            f"{name} must end in .npz, the ending of NumPy archives, or have no ending, got "
            f"{str(file)!r}"
        )
    return file.with_name(file.name.removesuffix(".npz") + ".npz")


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays and texts to the file `path` atomically."""
    from zipfile import ZipFile  # takes longer than the rest of this module

    with replace_when_complete(path) as part:
        np.savez_compressed(part, **arrays)
        # Its list of members has no checksum, so damage could hide some.
        with ZipFile(part, "a") as archive:
            archive.comment = b"%d arrays" % len(arrays)
    return path


@contextmanager
def explain_unreadable_file(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Turn every failure to understand the file `path` into a ValueError that names it."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        raise ValueError(
            f"{os.fspath(path)} is no {kind} of clothsim: {error or type(error).__name__}"
        ) from None


def read_npz(
    path: str | os.PathLike[str], kind: str, required: Collection[str]
) -> dict[str, np.ndarray]:
    """Read the arrays of a file of `write_npz`; a ValueError says why it is no `kind`."""
    from zipfile import ZipFile

    path = check.path("path", path)
    with open(path, "rb") as file, explain_unreadable_file(path, kind), ZipFile(file) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        if missing := sorted(set(required) - set(names)):
            raise ValueError(f"it lacks {', '.join(missing)}")
        if archive.comment != b"%d arrays" % len(names):
            raise ValueError("its list of arrays is damaged")
        # A member is read whole: only then does zipfile compare its checksum.
        return {
            name: np.lib.format.read_array(BytesIO(archive.read(f"{name}.npy")), allow_pickle=False)
            for name in names
        }


def _plain_data(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain_data(entry) for key, entry in value.items()}
    value = value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
    if isinstance(value, (list, tuple)):
        return [_plain_data(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)


def as_json(data: Any) -> str:
    """Write `data` as indented standard JSON: a number that is not finite becomes null, an object
    becomes its `str`.
    """
    return json.dumps(_plain_data(data), indent=1, allow_nan=False)
