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
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..errors import warn_caller
from ..model.scene import Scene
from .grid import Coordinate, Grid
from .member import PENDING, Record, SweepOptions
from .results import ATTRIBUTE, FRAMES, SCHEMA, SESSIONS, Results, Variable
from .stored import Lock, digests, find_damage, part_of, read_attrs, sealed

_CHUNK = 16_384  # members
_SECONDS_BETWEEN_WRITES = 1.0


class Store(Results):
    """Results that are also in a zarr group.

    Parameters
    ----------
    path : path
        Folder of the group; made if missing.
    identity : dict
        Identity of the sweep. A store with another identity is refused.
    session : dict
        Provenance of the results, which is stored beside them.
    resume : bool
        Whether an existing store may be continued.

    Raises
    ------
    ValueError
        If the folder is no store, another process writes to it, or its sweep differs.

    Warns
    -----
    RuntimeWarning
        If files of the store are damaged; the message names them. Their members are pending again.
    """

    def __init__(
        self,
        path: Path,
        grid: Grid,
        options: SweepOptions,
        scene: Scene,
        identity: dict[str, Any],
        session: dict[str, Any],
        resume: bool,
    ) -> None:
        self.path = check.folder("store", path)
        self.zarr = needed("zarr", "store=...")
        self._arrays: dict[str, Any] = {}
        self._touched: set[tuple[int, ...]] = set()  # chunks with values that are not on disk yet
        self._last_write = time.monotonic()
        self._prepared = False
        self._chunks = _chunks(grid.shape)
        self.session, self.sessions = session, [session]
        self.attrs: dict[str, Any] = {"schema": SCHEMA, "identity": identity}
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = Lock(path)
        try:
            self._lost = np.zeros(grid.shape, bool)  # members whose values are damaged
            if path.exists() and any(path.iterdir()):
                self._reopen(resume)
            super().__init__(grid, options, scene)
            self._load()
        except BaseException:
            self.close()
            raise

    def _reopen(self, resume: bool) -> None:
        """Take over what the store has, if it is of the same sweep and whole."""
        attrs, files = read_attrs(self.path)
        where = f"store {str(self.path)!r}"
        if not resume:
            raise ValueError(f"{where} exists; resume=True continues it")
        if found := differences(attrs["identity"], self.attrs["identity"]):
            shown = "; ".join(found[:6]) + (f"; and {len(found) - 6} more" if len(found) > 6 else "")
            raise ValueError(f"{where} is of another sweep; it differs in {shown}")
        self.sessions = [*attrs.pop("sessions"), self.session]
        if "files" not in attrs:  # stopped before it had anything
            _clear(self.path)
            return
        damage = find_damage(self.path, attrs)
        damage.files = [*dict.fromkeys(files + damage.files)]
        self._lost = damage.members
        for name in damage.arrays:
            shutil.rmtree(self.path / name, ignore_errors=True)
        if damage.files:
            warn_caller(
                f"{where} is damaged, see {damage.named()}; {int(damage.members.sum())} of {damage.members.size} "
                "members are computed again",
                RuntimeWarning,
            )
        self.attrs = attrs
        names = {file.partition("/")[0] for file in attrs["files"]} - damage.arrays
        self._arrays = {name: self._opened(name) for name in names}
        self.attrs["arrays"] = {name: more for name, more in attrs["arrays"].items() if name in names}
        if "zarr.json" in damage.files:
            (self.path / "zarr.json").unlink(missing_ok=True)

    def _opened(self, name: str) -> Any:
        return self.zarr.open_array(self.path / name, mode="r+").with_config({"write_empty_chunks": True})

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        if name not in FRAMES:
            return super()._allocate(name, shape, dtype, fill)
        # Frames stay on disk, where `prepare` makes room for them; this takes no memory.
        found: np.ndarray = self._arrays.get(name, np.broadcast_to(np.full((), fill, dtype), shape))
        return found

    def _load(self) -> None:
        """Read the values of all members that are not lost."""
        for name, more in self.attrs.get("arrays", {}).items():
            array = self._arrays[name]
            if name not in self.variables:  # of a user's function, known from the first result
                self._reopen_function(name, array, more)
        for name, variable in self.variables.items():
            if name in self._arrays and name not in FRAMES:
                for place in self._places():
                    part = part_of(place, self._chunks)
                    if not self._lost[part].all():
                        variable.values[part] = self._arrays[name][part]
        for variable in self.variables.values():
            if variable.name not in FRAMES:
                variable.values[self._lost] = variable.fill
        for place in self._places():
            if self._lost[part_of(place, self._chunks)].any():
                self._touched.add(place)

    def _reopen_function(self, name: str, array: Any, more: int) -> None:
        dims = array.metadata.dimension_names[len(self.grid.shape) :] if more else ()
        self.variables[name] = Variable(name, np.full(array.shape, np.nan), dict(array.attrs), tuple(dims))

    def _places(self) -> list[tuple[int, ...]]:
        """The chunks of the grid."""
        return list(np.ndindex(*(-(-n // c) for n, c in zip(self.grid.shape, self._chunks, strict=True))))

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
                self._create(variable)
        for coordinate in self.coordinates:
            if coordinate.name not in self._arrays:
                self._create_coordinate(coordinate)
        if SESSIONS not in self._arrays:
            self._create_array(SESSIONS, shape=(), dtype="str")
        self._describe()
        self._prepared = True

    def _create_array(self, name: str, **options: Any) -> Any:
        codecs = self.zarr.codecs.ZstdCodec(), self.zarr.codecs.Crc32cCodec()
        self._arrays[name] = self.group.create_array(
            name, compressors=codecs, config={"write_empty_chunks": True}, overwrite=True, **options
        )
        return self._arrays[name]

    def _create(self, variable: Variable) -> None:
        values, own = variable.values, len(self.grid.shape)
        frames = variable.name in FRAMES
        # A member's frames are written once and are a chunk each.
        array = self._create_array(
            variable.name,
            shape=values.shape,
            chunks=((1,) * own if frames else self._chunks) + values.shape[own:],
            dtype="str" if values.dtype.kind == "O" else values.dtype,
            fill_value=variable.fill,
            dimension_names=(*self.grid.dimensions, *variable.more),
            attributes=variable.attrs,
        )
        if frames:
            variable.values = array
        else:
            array[...] = values

    def _create_coordinate(self, coordinate: Coordinate) -> None:
        values = coordinate.values
        if values.dtype.kind == "U":
            values = values.astype(object)
        array = self._create_array(
            coordinate.name,
            shape=values.shape,
            dtype="str" if values.dtype.kind == "O" else values.dtype,
            dimension_names=(coordinate.dimension,),
            attributes=coordinate.attrs,
        )
        array[...] = values

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
        self._create(self.variables[name])
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


def _clear(path: Path) -> None:
    for entry in path.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def differences(theirs: Any, mine: Any, path: str = "") -> list[str]:
    """The differences of two plain values, as "path: theirs, mine" texts."""
    if isinstance(theirs, Mapping) and isinstance(mine, Mapping):
        found = []
        for key in dict.fromkeys([*theirs, *mine]):
            there = f"{path}.{key}" if path else str(key)
            if key not in mine or key not in theirs:
                has = "store" if key in theirs else "call"
                found.append(f"{there} (only in the {has})")
            else:
                found += differences(theirs[key], mine[key], there)
        return found
    if isinstance(theirs, list) and isinstance(mine, list) and len(theirs) == len(mine):
        pairs = zip(theirs, mine, strict=True)
        return [d for k, (a, b) in enumerate(pairs) for d in differences(a, b, f"{path}[{k}]")]
    if theirs == mine and isinstance(theirs, bool) == isinstance(mine, bool):
        return []
    return [f"{path} ({_short(theirs)} in the store, {_short(mine)} given)"]


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
