"""A sweep on disk: a zarr group that xarray opens, written by one process as members finish.

Variables are arrays over the grid in chunks; a chunk is replaced as a whole and atomically (zarr
writes a new file and renames it). `status` is written after everything else of the same members,
so a process killed at any moment leaves members that are whole or pending, nothing between.
"""

from __future__ import annotations

import json
import os
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ..scene import Scene
from .extras import needed
from .grid import Grid
from .member import PENDING, Settings
from .plain import differences
from .results import Results, Variable

SCHEMA = 1
"""Version of the layout of a store."""

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0


class Store(Results):
    """Results that are also in a zarr group.

    Parameters
    ----------
    path : path
        Folder of the group; made if missing.
    identity : dict
        What makes this sweep this sweep: a store with another is refused.
    provenance : dict
        Where the results come from; written beside them.
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
        if path.exists() and not path.is_dir():
            raise ValueError(f"store must be a folder, got the file {str(path)!r}")
        self.zarr = needed("zarr", "store=...")
        self.path = path
        self._arrays: dict[str, Any] = {}  # looking one up in the group reads a file
        self._touched: dict[str, set[tuple[int, ...]]] = {}
        self._last_write = time.monotonic()
        exists = path.exists() and any(path.iterdir())
        if exists:
            attrs = _check(self.zarr, path, identity, resume)
        path.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(path)
        try:
            if exists:
                self.group = self.zarr.open_group(path, mode="r+", use_consolidated=False)
            else:
                attrs = {"schema": SCHEMA, "identity": identity, "sessions": []}
                self.group = self.zarr.create_group(
                    path, zarr_format=3, attributes={"clothsim": json.dumps(attrs)}
                )
            # Whatever an earlier process was killed before making is made now.
            super().__init__(grid, settings, scene)
            self._reopen_functions()
            self._write_coordinates()
            attrs["sessions"].append(provenance)
            self.attrs, self.session = attrs, provenance
            self._write_attrs()
        except BaseException:
            self._release()
            raise

    def _allocate(
        self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any, more: tuple[str, ...]
    ) -> np.ndarray:
        if name in self.group:
            array = self.group[name]
        else:
            own = len(shape) - len(more)
            chunks = (*_chunks(shape[:own]), *shape[own:])
            if more == ("time", "row", "column", "component"):
                chunks = (*(1,) * own, *shape[own:])  # a member's frames are written once
            array = self.group.create_array(
                name,
                shape=shape,
                chunks=chunks,
                dtype="str" if dtype is object else dtype,
                fill_value=fill,
                dimension_names=(*self.grid.dimensions, *more),
            )
        self._arrays[name] = array
        if "time" in more:
            return array  # frames stay on disk
        return np.asarray(array[...], dtype=dtype).reshape(shape)

    def _add(self, name: str, *args: Any, **kwargs: Any) -> None:
        super()._add(name, *args, **kwargs)
        array = self._arrays[name]
        if dict(array.attrs) != self.variables[name].attrs:
            array.attrs.update(self.variables[name].attrs)

    def _reopen_functions(self) -> None:
        """Variables of user's functions, whose shape the first result has told."""
        known = {*self.variables, *(c.name for c in self.coordinates)}
        for name, array in self.group.arrays():
            if name not in known:
                self._arrays[name] = array
                more = array.metadata.dimension_names[len(self.grid.shape) :]
                self.variables[name] = Variable(name, array[...], dict(array.attrs), tuple(more))

    def _write_coordinates(self) -> None:
        for coordinate in self.coordinates:
            if coordinate.name in self.group:
                continue
            text = coordinate.values.dtype.kind == "U"
            array = self.group.create_array(
                coordinate.name,
                shape=coordinate.values.shape,
                dtype="str" if text else coordinate.values.dtype,
                dimension_names=(coordinate.dimension,),
                attributes=coordinate.attrs,
            )
            array[...] = coordinate.values.astype(object) if text else coordinate.values

    def _set(self, name: str, place: tuple[int, ...], value: Any) -> None:
        super()._set(name, place, value)
        chunks = self._arrays[name].chunks[: len(place)]
        self._touched.setdefault(name, set()).add(
            tuple(p // c for p, c in zip(place, chunks, strict=True))
        )

    def flush(self, final: bool = False) -> None:
        """Write the chunks that have changed, at most once a second unless `final`."""
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
        self._write_attrs()
        self._last_write = time.monotonic()

    def _write_attrs(self) -> None:
        status = self.variables["status"].values
        self.session["members_finished"] = int((status != PENDING).sum())
        self.attrs["variables"] = list(self.variables)
        self.group.attrs["clothsim"] = json.dumps(self.attrs)

    def close(self) -> None:
        """Let the store go; its metadata in one place make it quick to open."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # zarr calls consolidated metadata not yet standard
                self.zarr.consolidate_metadata(self.path)
        finally:
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


def _check(zarr: Any, path: Path, identity: dict[str, Any], resume: bool) -> dict[str, Any]:
    """The attributes of the store at `path`, if it is of the sweep `identity`."""
    attrs = read_attrs(path)
    if not resume:
        raise ValueError(f"store {str(path)!r} exists; resume=True continues it")
    found = differences(attrs["identity"], identity)
    if found:
        shown = "; ".join(found[:6]) + (f"; and {len(found) - 6} more" if len(found) > 6 else "")
        raise ValueError(f"store {str(path)!r} is of another sweep; it differs in {shown}")
    return attrs


def read_attrs(path: Path) -> dict[str, Any]:
    """What the store at `path` says of itself; a ValueError if it is none."""
    zarr = needed("zarr", "a sweep's store")
    try:
        attrs = json.loads(zarr.open_group(path, mode="r").attrs["clothsim"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"store {str(path)!r} is no store of a sweep ({error})") from None
    if attrs.get("schema") != SCHEMA:
        raise ValueError(
            f"store {str(path)!r} has schema {attrs.get('schema')}, "
            f"the version read here is {SCHEMA}"
        )
    return dict(attrs)


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
