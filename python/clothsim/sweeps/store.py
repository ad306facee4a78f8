"""Results of a sweep: arrays over the grid in memory, or on disk as a zarr group, which is written as members finish.

On disk, variables are arrays in chunks that end in their checksum (zarr's codec crc32c). zarr writes a new file for a
chunk and renames it, and `status` is written after everything else of its members: if the process is killed at any
moment, each member is either complete or pending. Every chunk exists from the start, so a missing one is not mistaken for
an empty one. Chunks of frames are written with their members.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Floats, check
from ..base.extras import needed
from ..model.scene import Scene
from ..run.frames import Schedule
from .grid import Coordinate, Grid
from .member import DONE, FAILED, PENDING, STATUS, Record, SweepOptions

if TYPE_CHECKING:
    import xarray

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0

FRAMES = ("position", "velocity")
"""The variables that have the frames of every member."""

ATTRIBUTE = "clothsim_sweep"
"""The attribute of Datasets and stores that identifies their sweep, as JSON text. Not "clothsim": that is the accessor,
which xarray would hide behind it."""

SCHEMA = 4
"""Version of the layout of a store, and of the attribute."""


@dataclass
class Variable:
    """A variable of the result over the grid, with further dimensions of its own at the end."""

    name: str
    values: np.ndarray
    attrs: dict[str, Any]
    more: tuple[str, ...] = ()
    fill: Any = np.nan  # of members that have no value


class Results:
    """The variables of a sweep.

    The status of a member is set last, so a member that is marked as done is always complete.
    """

    def __init__(self, grid: Grid, options: SweepOptions, scene: Scene) -> None:
        self.grid, self.options, self.scene = grid, options, scene
        self.variables: dict[str, Variable] = {}
        self.coordinates: list[Coordinate] = grid.coordinates()
        self._open_variables()
        if options.frames:
            self._open_frames()

    def _open_variables(self) -> None:
        flags = {"flag_values": list(range(len(STATUS))), "flag_meanings": " ".join(STATUS)}
        self._add("status", np.int8, PENDING, {"long_name": "what became of the member", **flags})
        self._add("max_stable_dt", float, np.nan, {"long_name": "guaranteed stable time step", "units": "s"})
        self._add("unstable_step", np.int64, -1, {"long_name": "step at which it diverged, -1: never", "units": "1"})
        self._add("unstable_time", float, np.nan, {"long_name": "time at which it diverged", "units": "s"})
        self._add("message", object, "", {"long_name": "why a member did not come to its end, or has no error"})
        for metric in self.options.metrics:
            for name, attrs in metric.variables.items():
                self._add(name, *((np.bool_, False) if name == "stable" else (float, np.nan)), attrs)

    def _open_frames(self) -> None:
        options = self.options
        frames = Schedule.of_every(options.every).in_seconds(options.dt or math.inf)
        times = np.array([t for _, t in frames.moments(0.0, options.duration)])
        swept = {name: axis.column(name) for axis in self.grid.axes for name in axis.names}
        shapes = swept.get("shape", []) + [scene.cloth.shape for scene in swept.get("scene", [])] or [self.scene.cloth.shape]
        rows, columns = map(max, zip(*shapes, strict=True))
        more = {"time": len(times), "row": rows, "column": columns, "component": 3}
        for name, unit in zip(FRAMES, ("m", "m/s"), strict=True):
            self._add(name, float, np.nan, {"long_name": f"{name} of the mass points", "units": unit}, **more)
        self.coordinates.append(Coordinate("time", "time", times, {"units": "s"}))
        self.coordinates.append(Coordinate("component", "component", np.array(["x", "y", "z"])))

    def _add(self, name: str, dtype: Any, fill: Any, attrs: Mapping[str, Any], **more: int) -> None:
        """Add a variable; `more` maps its own dimensions to their lengths."""
        if name in {*self.grid.dimensions, *(c.name for c in self.coordinates)}:
            raise ValueError(f"metrics: a function must not be named {name!r}, a coordinate of this sweep is")
        values = self._allocate(name, (*self.grid.shape, *more.values()), dtype, fill)
        self.variables[name] = Variable(name, values, dict(attrs), tuple(more), fill)

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        return np.full(shape, fill, dtype)

    @property
    def pending(self) -> np.ndarray:
        """Indices of the members to run: pending members and failed members."""
        status = self.variables["status"].values.ravel()
        return np.flatnonzero((status == PENDING) | (status == FAILED))

    def record(self, records: Iterable[Record]) -> None:
        """Store the results of members."""
        found = dict[str, tuple[list[int], list[Any]]]()
        for one in records:
            for name, value in one.values.items():
                places, values = found.setdefault(name, ([], []))
                places.append(one.index)
                values.append(value)
            if one.frames is not None:
                self._put_frames(one.index, one.frames)
        for name, (places, values) in found.items():
            self._put(name, places, values)
        for name in ("max_stable_dt", "unstable_step", "unstable_time", "message", "status"):
            flat = self.variables[name].values.reshape(-1)
            for one in records:
                flat[one.index] = getattr(one, name)

    def _put(self, name: str, places: list[int], values: list[Any]) -> None:
        if name not in self.variables:
            self._add_function(name, np.asarray(values[0]))
        array, own = self.variables[name].values, len(self.grid.shape)
        shapes = {getattr(value, "shape", ()) for value in values} - {array.shape[own:]}
        if shapes:
            raise ValueError(
                f"metric {name!r} must give every member an array of one shape, got {shapes.pop()} and {array.shape[own:]}"
            )
        array.reshape(-1, *array.shape[own:])[places] = values

    def _put_frames(self, index: int, frames: tuple[Floats, Floats]) -> None:
        place = tuple(map(int, np.unravel_index(index, self.grid.shape)))
        for name, given in zip(FRAMES, frames, strict=True):
            values = self.variables[name].values
            whole = np.full(values.shape[len(place) :], np.nan)
            whole[:, : given.shape[1], : given.shape[2]] = given
            values[place] = whole

    def _add_function(self, name: str, value: np.ndarray) -> None:
        more = {f"{name}_{k}": length for k, length in enumerate(value.shape)}
        self._add(name, float, np.nan, {"long_name": name.replace("_", " ")}, **more)

    def flush(self, final: bool = False) -> None:
        """Write pending results. In memory there is nothing to do."""

    def close(self) -> None:
        """End writing."""

    def dataset(self, attrs: Mapping[str, Any]) -> xarray.Dataset:
        """The results as a Dataset, with `attrs` as its identity."""
        dims = self.grid.dimensions
        found: xarray.Dataset = needed("xarray", "sweep").Dataset(
            {v.name: ((*dims, *v.more), v.values, v.attrs) for v in self.variables.values()},
            {c.name: (c.dimension, c.values, c.attrs) for c in self.coordinates},
            {ATTRIBUTE: json.dumps(attrs)},
        )
        return found


class Store(Results):
    """Results that are also in a zarr group, with the identity of the sweep, and the provenance of each `session`.

    A ValueError refuses a folder that is not a store, is being written, is damaged, or, unless `resume`, exists; and a store
    of another identity, with the differences.
    """

    def __init__(self, path: Path, resume: bool, identity: dict[str, Any], session: dict[str, Any], *sweep: Any) -> None:
        super().__init__(*sweep)
        self.path, self.zarr = path, needed("zarr", "store=...")
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
        for variable in self._status_last():
            self._create_variable(variable)

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

    def _add_function(self, name: str, value: np.ndarray) -> None:
        super()._add_function(name, value)
        self._create_variable(self.variables[name])

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
        for variable in self._status_last():
            if variable.name not in FRAMES:
                self._write(variable)
        self._touched.clear()
        self.session["members_finished"] = int((self.variables["status"].values != PENDING).sum())
        self.group.attrs[ATTRIBUTE] = self._about()
        self._last_write = time.monotonic()

    def _write(self, variable: Variable) -> None:
        for place in self._touched:
            part = tuple(slice(k * n, (k + 1) * n) for k, n in zip(place, self._chunks, strict=True))
            self._arrays[variable.name][part] = variable.values[part] if part else variable.values

    def _status_last(self) -> list[Variable]:
        return sorted(self.variables.values(), key=lambda variable: variable.name == "status")

    def close(self) -> None:
        """Release the store."""
        release(self._lock)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Whole last dimensions as far as they fit, then a part of one, then single places."""
    room = _CHUNK
    chunks = []
    for length in reversed(shape):
        chunks.append(max(1, min(length, room)))
        room //= max(length, 1)
    return tuple(reversed(chunks))


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

    A ValueError names an array that is damaged or lacks a chunk. Frames are only checked for their presence.
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


def differences(theirs: Any, mine: Any, path: str = "") -> list[str]:
    """The differences of two plain values, as "path (theirs in the store, mine given)" texts."""
    if isinstance(theirs, list) and isinstance(mine, list):
        theirs, mine = dict(enumerate(theirs)), dict(enumerate(mine))
    if isinstance(theirs, dict) and isinstance(mine, dict):
        both = [(theirs.get(key), mine.get(key), f"{path}.{key}".lstrip(".")) for key in {**theirs, **mine}]
        return [text for pair in both for text in differences(*pair)]
    there, here = json.dumps(theirs), json.dumps(mine)
    return [] if there == here else [f"{path} ({there:.60} in the store, {here:.60} given)"]


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
        If `path` is not the store of a sweep, or a chunk is damaged or missing, which the message names. Frames are checked
        when they are read.

    Examples
    --------
    >>> import tempfile
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
