"""A sweep on disk: a zarr group that xarray opens, written by one process as members finish.

Variables are arrays over the grid in chunks; a chunk is replaced as a whole and atomically (zarr
writes a new file and renames it). `status` is written after everything else of its members. A
process killed at any moment leaves members that are whole or pending.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..model.scene import Scene
from .attribute import ATTRIBUTE, OLD_ATTRIBUTE
from .grid import Coordinate, Grid
from .member import PENDING, Record, Settings
from .plain import differences
from .results import FRAMES, SESSIONS, Results, Variable

SCHEMA = 2
"""Version of the layout of a store."""

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0


class Store(Results):
    """Results that are also in a zarr group.

    The group's attributes identify the sweep and never change. The array "sessions" says where its
    results come from, as text that is replaced with every write.

    Parameters
    ----------
    path : path
        Folder of the group; made if missing.
    identity : dict
        Identity of the sweep. A store with another identity is refused.
    provenance : dict
        Provenance of the results, which is stored beside them.
    resume : bool
        Whether an existing store may be continued.

    Raises
    ------
    ValueError
        If the folder is no store, another process writes to it, or its sweep differs.
    """

    def __init__(
        self,
        path: Path,
        grid: Grid,
        settings: Settings,
        scene: Scene,
        identity: dict[str, Any],
        provenance: dict[str, Any],
        resume: bool,
    ) -> None:
        check.folder("store", path)
        self.zarr = needed("zarr", "store=...")
        self.path = path
        self.group: Any = None
        self._arrays: dict[str, Any] = {}  # looking one up in the group reads a file
        self._chunks: dict[str, tuple[int, ...]] = {}
        self._touched: dict[str, set[tuple[int, ...]]] = {}
        self._last_write = time.monotonic()
        self._prepared = False
        self.attrs: dict[str, Any] = {"schema": SCHEMA, "identity": identity, "sessions": []}
        exists = path.exists() and any(path.iterdir())
        if exists:
            self.attrs |= _check(path, identity, resume)
        path.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(path)
        try:
            if exists:
                self.group = self.zarr.open_group(path, mode="r+", use_consolidated=False)
                self._arrays = dict(self.group.arrays())
            super().__init__(grid, settings, scene)
            self._reopen_functions()
            self.session = provenance
            self.attrs["sessions"].append(provenance)
        except BaseException:
            self._release()
            raise

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        if name not in self._arrays:
            # Frames stay on disk, where `prepare` makes room for them; this takes no memory.
            return (
                np.broadcast_to(np.full((), fill, dtype), shape)
                if name in FRAMES
                else (super()._allocate(name, shape, dtype, fill))
            )
        array = self._arrays[name]
        return array if name in FRAMES else np.asarray(array[...], dtype=dtype).reshape(shape)

    def _reopen_functions(self) -> None:
        """Variables of the user's functions, whose shapes are known from the first result."""
        known = {*self.variables, *(c.name for c in self.coordinates), SESSIONS}
        for name, array in self._arrays.items():
            if name not in known:
                more = array.metadata.dimension_names[len(self.grid.shape) :]
                self.variables[name] = Variable(name, array[...], dict(array.attrs), tuple(more))

    def prepare(self) -> None:
        """Make the missing arrays: all, or the rest if an earlier process was killed."""
        if self.group is None:
            which = json.dumps({name: self.attrs[name] for name in ("schema", "identity")})
            self.group = self.zarr.create_group(self.path, zarr_format=3, attributes={ATTRIBUTE: which})
        missing = [v for v in self.variables.values() if v.name not in self._arrays]
        for variable in missing:
            self._create(variable)
        for coordinate in self.coordinates:
            if coordinate.name not in self._arrays:
                self._create_coordinate(coordinate)
        if SESSIONS not in self._arrays:
            self._arrays[SESSIONS] = self.group.create_array(SESSIONS, shape=(), dtype="str")
        self._write_sessions()
        if missing:
            self._summarise()
        self._prepared = True

    def _create(self, variable: Variable) -> None:
        values = variable.values
        own = values.ndim - len(variable.more)
        # A member's frames are written once and are a chunk each.
        chunks = (1,) * own if variable.name in FRAMES else _chunks(values.shape[:own])
        array = self._arrays[variable.name] = self.group.create_array(
            variable.name,
            shape=values.shape,
            chunks=(*chunks, *values.shape[own:]),
            dtype="str" if values.dtype.kind == "O" else values.dtype,
            fill_value=variable.fill,
            dimension_names=(*self.grid.dimensions, *variable.more),
            attributes=variable.attrs,
        )
        if variable.name in FRAMES:
            variable.values = array

    def _create_coordinate(self, coordinate: Coordinate) -> None:
        text = coordinate.values.dtype.kind == "U"
        array = self._arrays[coordinate.name] = self.group.create_array(
            coordinate.name,
            shape=coordinate.values.shape,
            dtype="str" if text else coordinate.values.dtype,
            dimension_names=(coordinate.dimension,),
            attributes=coordinate.attrs,
        )
        array[...] = coordinate.values.astype(object) if text else coordinate.values

    def _summarise(self) -> None:
        """Copy all metadata to one place, so that a reader opens the store faster."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zarr calls consolidated metadata not yet standard
            self.zarr.consolidate_metadata(self.path)

    def _add_function(self, name: str, value: np.ndarray) -> None:
        super()._add_function(name, value)
        self._create(self.variables[name])
        self._summarise()

    def record(self, record: Record) -> None:
        """Store the result of a member, if its arrays exist."""
        if self._prepared:
            super().record(record)

    def _changed(self, name: str, index: int) -> None:
        if name not in self._chunks:  # zarr makes them of the metadata each time they are asked for
            self._chunks[name] = self._arrays[name].chunks
        place = np.unravel_index(index, self.grid.shape)
        chunk = tuple(int(p) // c for p, c in zip(place, self._chunks[name], strict=False))
        self._touched.setdefault(name, set()).add(chunk)

    def flush(self, final: bool = False) -> None:
        """Write the chunks that have changed, at most once a second unless `final`."""
        if not self._prepared:  # stopped before there was anything
            return
        if not final and time.monotonic() - self._last_write < _SECONDS_BETWEEN_WRITES:
            return
        order = sorted(self._touched, key=lambda name: name == "status")
        for name in order:
            array, values = self._arrays[name], self.variables[name].values
            for chunk in self._touched[name]:
                sizes = array.chunks[: len(chunk)]
                part = tuple(slice(k * n, (k + 1) * n) for k, n in zip(chunk, sizes, strict=True))
                array[part] = values[part] if part else values
        self._touched.clear()
        self._write_sessions()
        self._last_write = time.monotonic()

    def _write_sessions(self) -> None:
        status = self.variables["status"].values
        self.session["members_finished"] = int((status != PENDING).sum())
        about = {"sessions": self.attrs["sessions"], "variables": list(self.variables)}
        self._arrays[SESSIONS][...] = json.dumps(about)

    def close(self) -> None:
        """Release the store."""
        self._release()

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Whole last dimensions as far as they fit, then a part of one, then single places."""
    room = _CHUNK
    chunks = []
    for length in reversed(shape):
        chunks.append(max(1, min(length, room)))
        room //= max(length, 1)
    return tuple(reversed(chunks))


def _check(path: Path, identity: dict[str, Any], resume: bool) -> dict[str, Any]:
    """Attributes of the store at `path`, if it is of the sweep `identity`."""
    attrs = read_attrs(path)
    if not resume:
        raise ValueError(f"store {str(path)!r} exists; resume=True continues it")
    found = differences(attrs["identity"], identity)
    if found:
        shown = "; ".join(found[:6]) + (f"; and {len(found) - 6} more" if len(found) > 6 else "")
        raise ValueError(f"store {str(path)!r} is of another sweep; it differs in {shown}")
    return attrs


def read_attrs(path: Path) -> dict[str, Any]:
    """Attributes of the store at `path`; a ValueError if it is none.

    "schema", "identity" and "sessions", and "variables" unless it was stopped before it had any.
    """
    zarr = needed("zarr", "a sweep's store")
    try:
        group = zarr.open_group(path, mode="r", use_consolidated=False)
        name = ATTRIBUTE if ATTRIBUTE in group.attrs else OLD_ATTRIBUTE
        attrs = json.loads(group.attrs[name])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"store {str(path)!r} is no store of a sweep ({error})") from None
    if attrs.get("schema") != SCHEMA:
        raise ValueError(f"store {str(path)!r} has schema {attrs.get('schema')}, the version read here is {SCHEMA}")
    text = str(group[SESSIONS][()]) if SESSIONS in group else ""
    return {**attrs, "sessions": [], **json.loads(text or "{}")}


def _locked(path: Path) -> int | None:
    """A lock that this process holds until it closes it or ends; None where there are none."""
    try:
        import fcntl
    except ImportError:  # not on this system
        return None
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        raise ValueError(f"store {str(path)!r} is being written by another process") from None
    return handle
