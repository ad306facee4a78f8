"""A store as it lies on disk: its attributes, its lock, what of it is damaged, and its Dataset.

Every chunk ends in its checksum (zarr's codec crc32c). The attributes have the digest (SHA-256) of each file that never
changes: the metadata of every array, and the coordinates. They carry a digest of themselves, and a copy of them lies in the
array "sessions". From the start every chunk is there, so that a deleted chunk is not taken for an empty one. Chunks of
frames come with their members.
"""

from __future__ import annotations

import json
import math
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import check
from ..base.extras import needed
from .grid import sha256
from .member import DONE
from .results import ATTRIBUTE, FRAMES, SCHEMA, SESSIONS

if TYPE_CHECKING:
    import xarray

_mine: set[Path] = set()  # files of the locks of this process
_CHECKSUM = 4  # bytes at the end of a chunk
_FILES_NAMED = 4  # in a message
_FRAMES_CHECKED = 1 << 30  # bytes of frames whose checksums are read where a store is opened: a second or two
_CONSOLIDATED = {"kind": "inline", "must_understand": False}


def sealed(attrs: Mapping[str, Any]) -> str:
    """Attributes as JSON text that carries its own digest."""
    return json.dumps({**attrs, "sha256": sha256(json.dumps(attrs).encode())})


def _unsealed(text: str) -> dict[str, Any]:
    attrs: dict[str, Any] = json.loads(text)
    if attrs.pop("sha256", None) != sha256(json.dumps(attrs).encode()):
        raise ValueError("its attributes do not match their digest")
    return attrs


def _sessions(path: Path) -> dict[str, Any]:
    """The text of the array "sessions": a copy of the attributes, and the sessions that worked on the store."""
    if not whole(path / SESSIONS / "c"):
        raise ValueError(f"{SESSIONS}/c is missing or damaged")
    return dict(json.loads(str(needed("zarr", "a sweep's store").open_array(path / SESSIONS, mode="r")[()])))


def read_attrs(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Attributes of the store at `path` with its "sessions", and the damaged files among those that have them.

    "files" has digests and "arrays" the number of further dimensions of each variable; both are missing in a store that
    was stopped before it had anything. A ValueError is raised if `path` is no store.
    """
    damaged: list[str] = []
    attrs: dict[str, Any] = {}
    try:
        attrs = _unsealed(json.loads((path / "zarr.json").read_bytes())["attributes"][ATTRIBUTE])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        damaged.append("zarr.json")
        reason: Exception = error
    try:
        text = _sessions(path) if damaged or attrs.get("files") else {}
        attrs = attrs or _unsealed(text["attributes"])
    except Exception:  # for damaged metadata zarr raises errors of many kinds
        if damaged:
            raise ValueError(f"store {str(path)!r} is no store of a sweep ({reason})") from None
        text = {}
        if not whole(path / SESSIONS / "c"):  # else its metadata are damaged, which have a digest
            damaged.append(f"{SESSIONS}/c")
    if attrs.get("schema") != SCHEMA:
        raise ValueError(f"store {str(path)!r} has schema {attrs.get('schema')}, the version read here is {SCHEMA}")
    return {**attrs, "sessions": text.get("sessions", [])}, damaged


def whole(path: Path) -> bool:
    """Whether a chunk is there and has its checksum."""
    with suppress(OSError):
        return checks(path.read_bytes())
    return False


def checks(chunk: bytes) -> bool:
    """Whether the bytes of a chunk end in their checksum."""
    import google_crc32c  # zarr requires it

    data, checksum = chunk[:-_CHECKSUM], chunk[-_CHECKSUM:]
    return bool(data) and google_crc32c.value(data) == int.from_bytes(checksum, "little")


def digests(path: Path, names: list[str], pattern: str) -> dict[str, str]:
    """The digests of files of these arrays, by their name in the store."""
    files = [file for name in names for file in sorted((path / name).rglob(pattern)) if file.is_file()]
    return {file.relative_to(path).as_posix(): sha256(file.read_bytes()) for file in files}


@dataclass
class Damage:
    """The damaged files of a store, the arrays of which a file that never changes is damaged, and the lost members."""

    files: list[str]
    arrays: set[str]
    members: np.ndarray  # bool, over the grid

    def __str__(self) -> str:
        more = len(self.files) - _FILES_NAMED
        named = ", ".join(self.files[:_FILES_NAMED]) + (f" and {more} more" if more > 0 else "")
        return f"{named}: this concerns {int(self.members.sum())} of {self.members.size} members"


def find_damage(path: Path, attrs: Mapping[str, Any], files: list[str], most: float = math.inf) -> Damage:
    """Check all files of a store with these attributes; `files` are known to be damaged.

    After `most` bytes of frames, check only whether the others are there.
    """
    shape, chunks, arrays = tuple(attrs["shape"]), tuple(attrs["chunks"]), attrs["arrays"]
    damage = Damage(list(files), set(), np.zeros(shape, bool))
    for name, digest in attrs["files"].items():
        file = path / name
        if not file.is_file() or sha256(file.read_bytes()) != digest:
            damage.files.append(name)
            damage.arrays.add(name.partition("/")[0])
    if not damage.files and not _copies_agree(path):
        damage.files.append("zarr.json")
    if damage.arrays & arrays.keys():
        damage.members[...] = True
    own = {name: more for name, more in arrays.items() if name not in FRAMES}
    for place in places(shape, chunks):
        files = [_chunk(name, place, more) for name, more in own.items()]
        if bad := [file for file in files if not whole(path / file)]:
            damage.files += bad
            damage.members[part_of(place, chunks)] = True
    if len(own) < len(arrays) and not damage.members.all():
        status = needed("zarr", "a sweep's store").open_array(path / "status", mode="r")[...]
        for place in zip(*np.nonzero((status == DONE) & ~damage.members), strict=True):
            files = [_chunk(name, place, arrays[name]) for name in FRAMES]
            if bad := [file for file in files if not (whole if most > 0 else Path.is_file)(path / file)]:
                damage.files += bad
                damage.members[place] = True
            elif most > 0:
                most -= sum((path / file).stat().st_size for file in files)
    return damage


def _copies_agree(path: Path) -> bool:
    """Whether the copies of all metadata in the group's file are those of the arrays."""
    try:
        group = json.loads((path / "zarr.json").read_bytes())
        copies = group.pop("consolidated_metadata", None) or {"metadata": {}, **_CONSOLIDATED}
        arrays = {name: json.loads((path / name / "zarr.json").read_bytes()) for name in copies["metadata"]}
        names = group["attributes"].keys()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False
    return bool(
        copies == {"metadata": arrays, **_CONSOLIDATED}
        and group.keys() == {"attributes", "zarr_format", "node_type"}
        and (group["zarr_format"], group["node_type"], *names) == (3, "group", ATTRIBUTE)
    )


def places(shape: tuple[int, ...], chunks: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """The chunks of a grid."""
    return iter(np.ndindex(*(-(-n // c) for n, c in zip(shape, chunks, strict=True))))


def part_of(place: tuple[int, ...], chunks: tuple[int, ...]) -> tuple[slice, ...]:
    """The members of a chunk."""
    return tuple(slice(k * n, (k + 1) * n) for k, n in zip(place, chunks, strict=True))


def _chunk(name: str, place: tuple[Any, ...], more: int) -> str:
    return "/".join([name, "c", *map(str, place), *["0"] * more])


class Lock:
    """The right to write to a store: a file beside it with the id of the process, which loses the right where it ends."""

    def __init__(self, path: Path) -> None:
        self._file = Path(f"{path.resolve()}.lock")  # one lock, whatever links lead to the store
        self._handle: int | None = None
        try:
            import fcntl
        except ImportError:  # not on this system
            return
        while self._handle is None:
            owner = f"process {os.getpid()}"
            # The system refuses no process its own lock, and drops it where the process closes the file.
            if self._file not in _mine:
                handle = os.open(self._file, os.O_RDWR | os.O_CREAT, 0o644)
                owner = os.read(handle, 200).decode(errors="replace").strip() or "another process"
                try:
                    fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    owner = ""
                except OSError:
                    os.close(handle)
            if owner:
                raise ValueError(f"store {str(path)!r} is being written by {owner}; wait for its end, or give another store")
            with suppress(FileNotFoundError):  # its last owner may have removed it since
                if os.path.samestat(os.fstat(handle), os.stat(self._file)):
                    self._handle = handle
                    _mine.add(self._file)
            if self._handle is None:
                os.close(handle)
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)

    def release(self) -> None:
        if self._handle is not None:
            self._file.unlink(missing_ok=True)
            os.close(self._handle)
            _mine.discard(self._file)
            self._handle = None


def open_sweep(path: str | os.PathLike[str]) -> xarray.Dataset:
    """Open the store of a sweep, finished or not.

    Parameters
    ----------
    path : path-like
        The ``store`` of `sweep`.

    Returns
    -------
    xarray.Dataset
        As `sweep` returns it. Values are read when they are used.

    Raises
    ------
    ValueError
        If `path` is no store of a sweep, or files of it are damaged or missing. The message names them.
    ImportError
        Without xarray and zarr (the extra "sweep").

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0, 2.0]}, duration=0.1,
    ...                     dt=0.01, metrics="stable", store=folder + "/s.zarr", progress=False)
    ...     again = cs.open_sweep(folder + "/s.zarr").load()
    >>> bool(again.stable.all())
    True
    """
    xr = needed("xarray", "open_sweep")
    needed("zarr", "a sweep's store")
    path = check.path("path", path)
    if not path.is_dir():
        raise ValueError(f"path must be the folder of a store, got {str(path)!r}")
    attrs, files = read_attrs(path)
    if "files" not in attrs:
        raise ValueError(f"path {str(path)!r} is a store that was stopped before it had anything")
    damage = find_damage(path, attrs, files, _FRAMES_CHECKED)
    if damage.files:
        raise ValueError(f"store {str(path)!r} is damaged, see {damage}; repeat the call of sweep, which mends it")
    dataset: xarray.Dataset = xr.open_zarr(path, chunks=None, consolidated=False)
    names = list(attrs["arrays"])
    labels = {file.partition("/")[0] for file in attrs["files"]} - {*names, SESSIONS}
    dataset = dataset.set_coords(labels)[names]
    # NumPy's new text type breaks xarray's `where` and the like; the old ones do not.
    for name, array in dataset.variables.items():
        if array.dtype.kind == "T":
            texts = array.values.astype(object)
            texts = texts if name == "message" else np.array(texts.tolist())
            dataset[name] = (array.dims, texts, array.attrs)
    dataset.attrs[ATTRIBUTE] = json.dumps({name: attrs[name] for name in ("schema", "identity", "sessions")})
    return dataset
