"""A sweep on disk: a zarr group that xarray opens, written by one process as members finish.

Variables are arrays over the grid, in chunks that end in their checksum (zarr's codec crc32c). zarr writes a new file for a
chunk and renames it, and `status` is written after everything else of its members: a process that is killed at any moment
leaves members that are whole or pending. From the start every chunk is there, so a missing one is not taken for an empty
one. Chunks of frames come with their members.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import check
from ..base.extras import needed
from .member import DONE, PENDING, Record
from .results import ATTRIBUTE, FRAMES, SCHEMA, Results, Variable

if TYPE_CHECKING:
    import xarray

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0


class Store(Results):
    """Results that are also in a zarr group, with the identity of the sweep, and the provenance of each `session`.

    A ValueError refuses a folder that is no store, is being written, is damaged, or, unless `resume`, exists; and a store
    of another identity, with the differences.
    """

    def __init__(self, path: Path, resume: bool, identity: dict[str, Any], session: dict[str, Any], *sweep: Any) -> None:
        super().__init__(*sweep)
        self.path, self.zarr = check.folder("store", path), needed("zarr", "store=...")
        self.session, self.sessions, self._identity = session, [session], identity
        self._arrays: dict[str, Any] = {}
        self._chunks = _chunks(self.grid.shape)
        self._touched: set[tuple[int, ...]] = set()  # chunks with values that are not on disk yet
        self._last_write = time.monotonic()
        begun = (path / "zarr.json").exists()
        if not begun and path.exists() and any(path.iterdir()):
            raise ValueError(f"store {str(path)!r} is no store of a sweep")
        path.mkdir(parents=True, exist_ok=True)
        self._lock = locked(path)
        try:
            if begun:
                self._check(resume)
                self.group = self.zarr.open_group(path, mode="r+", use_consolidated=False)
            else:
                self.group = self.zarr.create_group(path, zarr_format=3, attributes={ATTRIBUTE: self._about()})
            if (path / "status" / "zarr.json").exists():
                self._load()
            else:  # new, or killed before it had anything
                self._create_all()
        except BaseException:
            self.close()
            raise

    def _about(self) -> str:
        return json.dumps({"schema": SCHEMA, "identity": self._identity, "sessions": self.sessions})

    def _check(self, resume: bool) -> None:
        """Refuse a store that may not be continued, or is of another sweep."""
        about, where = read_attrs(self.path), f"store {str(self.path)!r}"
        if not resume:
            raise ValueError(f"{where} exists; resume=True continues it")
        if found := differences(about["identity"], self._identity):
            shown = "; ".join(found[:6]) + (f"; and {len(found) - 6} more" if len(found) > 6 else "")
            raise ValueError(f"{where} is of another sweep; it differs in {shown}")
        self.sessions = [*about["sessions"], self.session]

    def _load(self) -> None:
        """Read the values of all members that have ended."""
        arrays, values = read(self.path, self.group, self.variables)
        for name, array in arrays.items():
            self._arrays[name] = array.with_config({"write_empty_chunks": True})
            if name not in self.variables:  # of a user's function, known from the first result
                more = tuple((array.metadata.dimension_names or ())[len(self.grid.shape) :])
                self.variables[name] = Variable(name, values[name], dict(array.attrs), more)
            elif name in FRAMES:
                self.variables[name].values = self._arrays[name]
            else:
                self.variables[name].values[...] = values[name]

    def _create_all(self) -> None:
        for label in self.coordinates:
            self._create(label.name, label.values, (label.dimension,), label.attrs, chunks=label.values.shape)
        # As xarray reads it: the coordinates that are not named after their dimension.
        self.group.attrs["coordinates"] = " ".join(c.name for c in self.coordinates if c.name != c.dimension)
        for variable in sorted(self.variables.values(), key=_status_last):
            self._create_variable(variable)
        self._consolidate()

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        if name in FRAMES:  # they stay on disk; this takes no memory
            return np.broadcast_to(np.full((), fill, dtype), shape)
        return super()._allocate(name, shape, dtype, fill)

    def _create(self, name: str, values: np.ndarray, dims: Sequence[str], attrs: Mapping[str, Any], **layout: Any) -> Any:
        text = values.dtype.kind in "OU"
        array = self.group.create_array(
            name,
            shape=values.shape,
            dtype="str" if text else values.dtype,
            dimension_names=dims,
            attributes=attrs,
            compressors=(self.zarr.codecs.ZstdCodec(), self.zarr.codecs.Crc32cCodec()),
            config={"write_empty_chunks": True},
            overwrite=True,
            **layout,
        )
        if name not in FRAMES:
            array[...] = values.astype(object) if text else values
        return array

    def _create_variable(self, variable: Variable) -> None:
        name, values, own = variable.name, variable.values, len(self.grid.shape)
        # A member's frames are written once and are a chunk each.
        chunks = ((1,) * own if name in FRAMES else self._chunks) + values.shape[own:]
        dims = (*self.grid.dimensions, *variable.more)
        self._arrays[name] = self._create(name, values, dims, variable.attrs, chunks=chunks, fill_value=variable.fill)
        if name in FRAMES:
            variable.values = self._arrays[name]

    def _consolidate(self) -> None:
        """Write all metadata in one place, for fast readers."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zarr calls it not yet standard
            self.group = self.zarr.consolidate_metadata(self.path)

    def _add_function(self, name: str, value: np.ndarray) -> None:
        super()._add_function(name, value)
        self._create_variable(self.variables[name])
        self._consolidate()

    def record(self, records: Iterable[Record]) -> None:
        """Store the results of members."""
        super().record(records)
        for one in records:
            place = np.unravel_index(one.index, self.grid.shape)
            self._touched.add(tuple(int(p) // c for p, c in zip(place, self._chunks, strict=True)))

    def flush(self, final: bool = False) -> None:
        """Write the chunks that have changed, at most once a second unless `final`."""
        if not final and time.monotonic() - self._last_write < _SECONDS_BETWEEN_WRITES:
            return
        for variable in sorted(self.variables.values(), key=_status_last):
            if variable.name not in FRAMES:
                self._write(variable)
        self._touched.clear()
        self.session["members_finished"] = int((self.variables["status"].values != PENDING).sum())
        self.group.attrs[ATTRIBUTE] = self._about()
        self._last_write = time.monotonic()

    def _write(self, variable: Variable) -> None:
        for place in self._touched:
            part = _part(place, self._chunks)
            self._arrays[variable.name][part] = variable.values[part] if part else variable.values

    def close(self) -> None:
        """Release the store."""
        release(self._lock)


def _status_last(variable: Variable) -> bool:
    return variable.name == "status"


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Whole last dimensions as far as they fit, then a part of one, then single places."""
    room = _CHUNK
    chunks = []
    for length in reversed(shape):
        chunks.append(max(1, min(length, room)))
        room //= max(length, 1)
    return tuple(reversed(chunks))


def _part(place: tuple[int, ...], chunks: tuple[int, ...]) -> tuple[slice, ...]:
    """The members of a chunk."""
    return tuple(slice(k * n, (k + 1) * n) for k, n in zip(place, chunks, strict=True))


def read_attrs(path: Path) -> dict[str, Any]:
    """The schema, identity and sessions of the store at `path`; a ValueError if it is none."""
    try:
        about = dict(json.loads(json.loads((path / "zarr.json").read_bytes())["attributes"][ATTRIBUTE]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"store {str(path)!r} is no store of a sweep ({error})") from None
    if about.get("schema") != SCHEMA:
        raise ValueError(f"store {str(path)!r} has schema {about.get('schema')}, the version read here is {SCHEMA}")
    return about


def read(path: Path, group: Any, names: Iterable[str] = ()) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The arrays that have a value for each member, `names` among them, and the values of all arrays but the frames.

    A ValueError names an array that is damaged or lacks a chunk. Of frames it is only seen whether they are there.
    """
    arrays, values, name = dict[str, Any](), dict[str, np.ndarray](), "status"
    try:
        labels = {*group.attrs.get("coordinates", "").split()}
        done = np.argwhere(group[name][...] == DONE)
        for name in sorted({"status", *group.array_keys(), *names}):
            array = arrays[name] = group[name]
            labels.update(array.metadata.dimension_names or ())
            if name in FRAMES:
                keys = [array.metadata.encode_chunk_key((*member, 0, 0, 0, 0)) for member in done.tolist()]
                whole = all((path / name / key).exists() for key in keys)
            else:  # zarr takes a chunk without a file for empty, which it is of "status" alone
                whole, values[name] = not len(done) or array.nchunks_initialized == array.nchunks, array[...]
            if not whole and name != "status":
                raise FileNotFoundError("a chunk is missing")
    except Exception as error:  # of zarr, of many kinds
        raise ValueError(f"store {str(path)!r} is damaged at {name} ({type(error).__name__}: {error}): delete it") from None
    return {name: one for name, one in arrays.items() if name not in labels}, values


def differences(theirs: Any, mine: Any) -> list[str]:
    """The differences of two plain values, as "path (theirs in the store, mine given)" texts."""
    there, here = dict(_leaves(theirs)), dict(_leaves(mine))
    found = []
    for path in dict.fromkeys([*there, *here]):
        if path not in here or path not in there:
            found.append(f"{path} (only in the {'store' if path in there else 'call'})")
        elif there[path] != here[path] or isinstance(there[path], bool) != isinstance(here[path], bool):
            found.append(f"{path} ({_short(there[path])} in the store, {_short(here[path])} given)")
    return found


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers and texts of a plain value, each with its path."""
    inner = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else None
    if inner is None:
        yield path, value
    else:
        for key, entry in inner:
            step = f"[{key}]" if isinstance(value, list) else f".{key}" if path else str(key)
            yield from _leaves(entry, path + step)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


_held: set[int] = set()  # descriptors of locks


def _forget() -> None:
    """Close the locks in a process that is forked: they end with the process that took them."""
    while _held:
        os.close(_held.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def locked(path: Path) -> int:
    """A lock on the folder of a store, which ends with its process, as a descriptor; -1 where the system has none."""
    try:
        import fcntl
    except ImportError:
        return -1
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        if isinstance(error, BlockingIOError):
            where = f"store {str(path)!r} is being written by a sweep"
            raise ValueError(f"{where}; wait for its end, or give another store") from None
        return -1
    _held.add(handle)
    return handle


def release(handle: int) -> None:
    if handle in _held:
        _held.remove(handle)
        os.close(handle)


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
        If `path` is no store of a sweep, or a chunk is damaged or missing, which the message names. Frames are checked
        when they are read.
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
    xr, zarr = needed("xarray", "open_sweep"), needed("zarr", "a sweep's store")
    path = check.path("path", path)
    if not path.is_dir():
        raise ValueError(f"path must be the folder of a store, got {str(path)!r}")
    read_attrs(path)
    if not (path / "status" / "zarr.json").exists():
        raise ValueError(f"path {str(path)!r} is a store that was stopped before it had anything")
    group = zarr.open_group(path, mode="r", use_consolidated=False)
    variables, _ = read(path, group)
    dataset: xarray.Dataset = xr.open_zarr(path, chunks=None, consolidated=False)[list(variables)]
    # NumPy's new text type breaks xarray's `where` and the like; the old ones do not.
    for name, array in dataset.variables.items():
        if array.dtype.kind == "T":
            texts = array.values.astype(object)
            texts = texts if name == "message" else np.array(texts.tolist())
            dataset[name] = (array.dims, texts, array.attrs)
    return dataset
