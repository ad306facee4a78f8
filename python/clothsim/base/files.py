"""Files that the package writes: whole or not at all; and NumPy archives (.npz) without pickle.

A file is written in a new folder beside its target, forced to the disk, and then renamed to its target. The new folder has
a random name and belongs to this user alone, so no symbolic link can lie in it. A full disk or a kill leaves the old file
as it was. A later save to the same target removes folders that a killed process has left.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import check

try:
    import fcntl
except ImportError:  # Windows, which renames no file that is in use
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from zipfile import ZipFile  # takes longer than the rest of this module

PIECE = 1 << 20  # bytes that are deflated between two checks for Ctrl-C: 0.03 s
_NO_LOCKS = -1  # the system or the file system has no locks
_DIGESTS = "digests"  # name of the member of an archive that has the digest of each other member


@contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """A new folder beside `path`, for files that `put` moves to their places; it is removed at the end."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder, got {str(path)!r}")
    if path.exists() and not path.is_file():
        raise ValueError(f"path must be a file, or not exist yet, got {str(path)!r}, which is a folder or device")
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"path must be a file that may be written, got {str(path)!r}, which is read-only")
    start = f".clothsim-{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]}-"
    try:
        _remove_left_over(path.parent, start)
        folder, lock = _made(path.parent, start)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            if lock != _NO_LOCKS:
                os.close(lock)
    except OSError as error:
        if error.errno:
            error.filename, error.filename2 = str(path), None  # the user does not know the folder's name
        raise


def _made(parent: Path, start: str) -> tuple[Path, int]:
    """A new folder and its lock."""
    while True:
        folder = parent / (start + secrets.token_hex(8))
        folder.mkdir(mode=0o700)
        lock = _locked(folder)
        if lock is not None:  # else another process took the new folder for a left-over one
            return folder, lock


def _locked(folder: Path, *, at_once: bool = False) -> int | None:
    """A lock of a folder; None where another process has the lock or has removed the folder."""
    if fcntl is None:
        return _NO_LOCKS
    try:
        opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return None
    lock: int | None = None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | (fcntl.LOCK_NB if at_once else 0))
        if folder.exists():
            lock = opened
    except BlockingIOError:
        pass
    except OSError:
        lock = _NO_LOCKS
    if lock != opened:
        os.close(opened)
    return lock


def _remove_left_over(parent: Path, start: str) -> None:
    """Remove folders of this start that no process holds."""
    for name in os.listdir(parent):
        if name.startswith(start):
            with suppress(OSError):  # not ours
                lock = _locked(parent / name, at_once=True)
                if lock not in (None, _NO_LOCKS):
                    shutil.rmtree(parent / name, ignore_errors=True)
                    os.close(lock)


def put(files: Sequence[Path], folder: Path) -> list[Path]:
    """Move complete files to `folder`, the first one last; a symbolic link there is replaced, not followed."""
    for file in files:
        _to_disk(file)
    places = [folder / file.name for file in files]
    for file, place in reversed(list(zip(files, places))):
        with suppress(FileNotFoundError):
            before = place.lstat()
            if stat.S_ISREG(before.st_mode):
                file.chmod(stat.S_IMODE(before.st_mode))
        os.replace(file, place)
    with suppress(OSError):  # some file systems take no such order for a folder
        _to_disk(folder)
    return places


def _to_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    if os.name == "nt" and path.is_dir():
        return
    opened = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


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
    if found.suffix == ".npz":
        return found
    if found.suffix:
        raise ValueError(
            f"{name} must end in .npz or have no ending, got {str(found)!r}; the file is a NumPy "
            "archive, which readers of other formats cannot open"
        )
    return found.with_name(found.name + ".npz")


class _Digesting:
    """A file that passes on what is written to it, and keeps its digest."""

    def __init__(self, file: Any) -> None:
        self._file, self.found = file, hashlib.sha256()

    def write(self, data: bytes) -> None:
        for start in range(0, len(data), PIECE):  # Ctrl-C acts between two pieces
            piece = data[start : start + PIECE]
            self.found.update(piece)
            self._file.write(piece)


def write_npz(path: Path, arrays: dict[str, Any]) -> Path:
    """Write arrays and texts, with the SHA-256 of each, to the file `path`, whole or not at all."""
    from zipfile import ZIP_DEFLATED, ZipFile

    digests: dict[str, str] = {}
    with replacing(path) as part, ZipFile(part, "w", ZIP_DEFLATED) as archive:

        def add(name: str, value: Any) -> None:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                digesting = _Digesting(file)
                np.lib.format.write_array(digesting, np.asanyarray(value), allow_pickle=False)
            digests[name] = digesting.found.hexdigest()

        for name, value in arrays.items():
            add(name, value)
        add(_DIGESTS, json.dumps(digests))
    return path


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
        names = {name.removesuffix(".npy") for name in archive.namelist()}
        if missing := sorted(set(needed) - names):
            raise ValueError(f"it lacks {', '.join(missing)}")
        if _DIGESTS not in names:
            raise ValueError("it lacks the digests of its arrays, so damage could not be seen")
        digests = json.loads(str(_array(archive.read(f"{_DIGESTS}.npy"))))
        if names - {_DIGESTS} != set(digests):
            raise ValueError(f"its arrays are {sorted(names)}, and its digests are of {sorted(digests)}")
        return {name: _verified(archive, name, digest) for name, digest in digests.items()}


def _verified(archive: ZipFile, name: str, digest: str) -> np.ndarray:
    data = archive.read(f"{name}.npy")
    found = hashlib.sha256()
    for start in range(0, len(data), PIECE):  # so that Ctrl-C need not wait for all of it
        found.update(memoryview(data)[start : start + PIECE])
    if found.hexdigest() != digest:
        raise ValueError(f"the array {name} is damaged: its digest differs")
    return _array(data)


def _array(data: bytes) -> np.ndarray:
    found: np.ndarray = np.lib.format.read_array(BytesIO(data), allow_pickle=False)
    return found
