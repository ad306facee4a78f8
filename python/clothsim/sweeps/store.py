"""A sweep on disk: a zarr group that xarray opens, written by one process as members finish.

Variables are arrays over the grid in chunks; a chunk is replaced as a whole and atomically (zarr
writes a new file and renames it). `status` is written after everything else of its members. A
process killed at any moment leaves members that are whole or pending.
"""

from __future__ import annotations

import json
import shutil
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..errors import warn_caller
from .member import PENDING, Record
from .results import ATTRIBUTE, FRAMES, SCHEMA, SESSIONS, Results, Variable
from .stored import Lock, digests, find_damage, part_of, places, read_attrs, sealed

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0


class Store(Results):
    """Results that are also in a zarr group, with the identity of the sweep, and the provenance of each `session`.

    A ValueError refuses a folder that is no store, is being written, or, unless `resume`, exists; and a store of another
    identity, with the differences. A warning names damaged files. Their members are pending again.
    """

    def __init__(self, path: Path, resume: bool, identity: dict[str, Any], session: dict[str, Any], *sweep: Any) -> None:
        self.path = check.folder("store", path)
        self.zarr = needed("zarr", "store=...")
        self.attrs: dict[str, Any] = {"schema": SCHEMA, "identity": identity}
        self.session, self.sessions = session, [session]
        self._arrays: dict[str, Any] = {}
        self._touched: set[tuple[int, ...]] = set()  # chunks with values that are not on disk yet
        self._last_write = time.monotonic()
        self._prepared = False
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = Lock(path)
        try:
            # Members whose values are damaged.
            lost = self._reopen(resume) if path.exists() and any(path.iterdir()) else None
            super().__init__(*sweep)
            self._chunks = _chunks(self.grid.shape)
            self._load(np.zeros(self.grid.shape, bool) if lost is None else lost)
        except BaseException:
            self.close()
            raise

    def _reopen(self, resume: bool) -> np.ndarray | None:
        """Take over what the store has, if it is of the same sweep; return the members of which something is damaged."""
        attrs, files = read_attrs(self.path)
        where = f"store {str(self.path)!r}"
        if not resume:
            raise ValueError(f"{where} exists; resume=True continues it")
        if found := differences(attrs["identity"], self.attrs["identity"]):
            shown = "; ".join(found[:6]) + (f"; and {len(found) - 6} more" if len(found) > 6 else "")
            raise ValueError(f"{where} is of another sweep; it differs in {shown}")
        self.sessions = [*attrs.pop("sessions"), self.session]
        if "files" not in attrs:  # stopped before it had anything
            return None
        damage = find_damage(self.path, attrs, files)
        if damage.files:
            warn_caller(f"{where} is damaged, see {damage}, which are computed again", RuntimeWarning)
        if "zarr.json" in damage.files:
            (self.path / "zarr.json").unlink(missing_ok=True)
        for name in damage.arrays:
            shutil.rmtree(self.path / name, ignore_errors=True)
        names = {file.partition("/")[0] for file in attrs["files"]} - damage.arrays
        for name in names:
            array = self.zarr.open_array(self.path / name, mode="r+")
            self._arrays[name] = array.with_config({"write_empty_chunks": True})
        self.attrs = {**attrs, "arrays": {name: more for name, more in attrs["arrays"].items() if name in names}}
        return damage.members

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        if name not in FRAMES:
            return super()._allocate(name, shape, dtype, fill)
        # Frames stay on disk, where `prepare` makes room for them; this takes no memory.
        found: np.ndarray = self._arrays.get(name, np.broadcast_to(np.full((), fill, dtype), shape))
        return found

    def _load(self, lost: np.ndarray) -> None:
        """Read the values of all members that are not lost."""
        for name in self.attrs.get("arrays", {}):
            if name not in self.variables:  # of a user's function, known from the first result
                array = self._arrays[name]
                more = array.metadata.dimension_names[lost.ndim :] if array.ndim else ()
                self.variables[name] = Variable(name, np.full(array.shape, np.nan), dict(array.attrs), tuple(more))
        kept = [v for v in self.variables.values() if v.name not in FRAMES and v.name in self._arrays]
        for place in places(self.grid.shape, self._chunks):
            part = part_of(place, self._chunks)
            if lost[part].any():
                self._touched.add(place)
            for variable in kept:
                if not lost[part].all():
                    variable.values[part] = self._arrays[variable.name][part]
        for variable in kept:
            variable.values[lost] = variable.fill

    def prepare(self) -> None:
        """Make the missing arrays: all, or damaged ones."""
        self.path.mkdir(exist_ok=True)
        if not (self.path / "zarr.json").exists():
            self.zarr.create_group(self.path, zarr_format=3, attributes={ATTRIBUTE: sealed(self.attrs)})
        if "status" in self._arrays:
            # Lost members are pending on disk before anything of them is replaced.
            self._write(self.variables["status"])
        self.group = self.zarr.open_group(self.path, mode="r+", use_consolidated=False)
        for variable in self.variables.values():
            if variable.name not in self._arrays:
                self._create_variable(variable)
        for label in self.coordinates:
            if label.name not in self._arrays:
                self._create(label.name, label.values, (label.dimension,), label.attrs)
        if SESSIONS not in self._arrays:
            self._create(SESSIONS, np.array("", object), (), {})
        self._describe()
        self._prepared = True

    def _create(self, name: str, values: np.ndarray, dims: Sequence[str], attrs: Mapping[str, Any], **layout: Any) -> Any:
        text = values.dtype.kind in "OU"
        array = self._arrays[name] = self.group.create_array(
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
        array = self._create(name, values, dims, variable.attrs, chunks=chunks, fill_value=variable.fill)
        if name in FRAMES:
            variable.values = array

    def _describe(self) -> None:
        """Write what the store has: the digests of its files, and all metadata in one place for fast readers."""
        labels = [coordinate.name for coordinate in self.coordinates]
        self.attrs |= {
            "shape": self.grid.shape,
            "chunks": self._chunks,
            "arrays": {v.name: len(v.more) for v in self.variables.values()},
            "files": digests(self.path, list(self._arrays), "zarr.json") | digests(self.path, labels, "*"),
        }
        self._write_sessions()
        self.group.attrs[ATTRIBUTE] = sealed(self.attrs)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # zarr calls consolidated metadata not yet standard
            self.zarr.consolidate_metadata(self.path)

    def _add_function(self, name: str, value: np.ndarray) -> None:
        super()._add_function(name, value)
        self._create_variable(self.variables[name])
        self._describe()

    def record(self, record: Record) -> None:
        """Store the result of a member, if its arrays exist."""
        if self._prepared:
            super().record(record)
            place = np.unravel_index(record.index, self.grid.shape)
            self._touched.add(tuple(int(p) // c for p, c in zip(place, self._chunks, strict=True)))

    def flush(self, final: bool = False) -> None:
        """Write the chunks that have changed, at most once a second unless `final`."""
        if not self._prepared:  # stopped before there was anything
            return
        if not final and time.monotonic() - self._last_write < _SECONDS_BETWEEN_WRITES:
            return
        for variable in sorted(self.variables.values(), key=lambda variable: variable.name == "status"):
            if variable.name not in FRAMES:
                self._write(variable)
        self._touched.clear()
        self._write_sessions()
        self._last_write = time.monotonic()

    def _write(self, variable: Variable) -> None:
        for place in self._touched:
            part = part_of(place, self._chunks)
            self._arrays[variable.name][part] = variable.values[part] if part else variable.values

    def _write_sessions(self) -> None:
        self.session["members_finished"] = int((self.variables["status"].values != PENDING).sum())
        self._arrays[SESSIONS][...] = json.dumps({"attributes": sealed(self.attrs), "sessions": self.sessions})

    def close(self) -> None:
        """Release the store."""
        self._lock.release()


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Whole last dimensions as far as they fit, then a part of one, then single places."""
    room = _CHUNK
    chunks = []
    for length in reversed(shape):
        chunks.append(max(1, min(length, room)))
        room //= max(length, 1)
    return tuple(reversed(chunks))


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
