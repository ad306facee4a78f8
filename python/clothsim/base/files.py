"""Files that the package writes: whole or not at all; and NumPy archives (.npz) without pickle.

A file is written in a new folder beside its target, forced to the disk, and then renamed to its target. A full disk or a
kill leaves the old file as it was.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from . import check

PIECE = 1 << 20  # bytes that are deflated between two checks for Ctrl-C: 0.03 s


@contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """A new folder beside `path`, for files that `put` moves to their places; it is removed at the end."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder, got {str(path)!r}")
    if path.exists() and not path.is_file():
        raise ValueError(f"path must be a file, or not exist yet, got {str(path)!r}, which is a folder or device")
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"path must be a file that may be written, got {str(path)!r}, which is read-only")
    try:
        with TemporaryDirectory(prefix=".clothsim-", dir=path.parent) as folder:
            yield Path(folder)
    except OSError as error:
        if error.errno:
            error.filename = str(path)  # the user does not know the folder's name
            del error.filename2  # None would be shown as " -> None"
        raise


def put(files: Sequence[Path], folder: Path) -> list[Path]:
    """Move complete files to `folder`, the first one last; a symbolic link there is replaced, not followed."""
    places = [folder / file.name for file in files]
    for file, place in reversed(list(zip(files, places))):
        with open(file, "r+b") as written:
            os.fsync(written.fileno())
        if place.is_file() and not place.is_symlink():
            shutil.copymode(place, file)
        os.replace(file, place)
    return places


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A new file to write, which replaces `path` at the end of the block, unless the block raises."""
    with folder_beside(path) as folder:
        yield folder / path.name
        put([folder / path.name], path.parent)


def write_bytes(path: Path, data: bytes) -> Path:
    """Write a file, whole or not at all."""
    with replacing(path) as part:
        part.write_bytes(data)
    return path


def npz_path(path: str | os.PathLike[str], name: str = "path") -> Path:
    """`path` as the path of a .npz file; the ending is added where there is none."""
    found = check.path(name, path)
    if found.suffix not in ("", ".npz"):
        raise ValueError(
            f"{name} must end in .npz or have no ending, got {str(found)!r}; the file is a NumPy "
            "archive, which readers of other formats cannot open"
        )
    return found.with_name(found.name.removesuffix(".npz") + ".npz")


class _Pieces:
    """A file that takes what is written to it in pieces, so that Ctrl-C acts between two."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def write(self, data: bytes) -> None:
        for start in range(0, len(data), PIECE):
            self._file.write(data[start : start + PIECE])


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays and texts to the file `path`, whole or not at all."""
    from zipfile import ZIP_DEFLATED, ZipFile  # takes longer than the rest of this module

    with replacing(path) as part, ZipFile(part, "w", ZIP_DEFLATED) as archive:
        archive.comment = _count(arrays)
        for name, value in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(_Pieces(file), np.asanyarray(value), allow_pickle=False)
    return path


def _count(names: Collection[str]) -> bytes:
    """The comment of an archive: its list of members has no checksum, so damage could hide some."""
    return b"%d arrays" % len(names)


@contextmanager
def reading(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Turn every failure to understand the file `path` into a ValueError that names it."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        raise ValueError(f"{os.fspath(path)} is no {what} of clothsim: {error or type(error).__name__}") from None


def read_npz(path: str | os.PathLike[str], what: str, needed: Collection[str]) -> dict[str, np.ndarray]:
    """The arrays of a file that `write_npz` wrote, or a ValueError that says why it is no `what`."""
    from zipfile import ZipFile

    path = check.path("path", path)
    with open(path, "rb") as file, reading(path, what), ZipFile(file) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        if missing := sorted(set(needed) - set(names)):
            raise ValueError(f"it lacks {', '.join(missing)}")
        if archive.comment != _count(names):
            raise ValueError("its list of arrays is damaged")
        # A member is read whole: only then does zipfile compare its checksum.
        return {name: np.lib.format.read_array(BytesIO(archive.read(f"{name}.npy")), allow_pickle=False) for name in names}
