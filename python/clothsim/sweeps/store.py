"""Results of a sweep: arrays over its members, and a zarr store that is written as members finish.

xarray writes the store, in chunks that end in their checksum (zarr's codec crc32c). zarr writes a
new file for a chunk and renames it, and `status` is written after everything else: if the process
is killed at any moment, each member is either complete or pending. Every chunk exists from the
start, so a missing one is not mistaken for an empty one.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

try:
    import fcntl
except ImportError:  # Windows has none.
    fcntl = None  # type: ignore[assignment]

from ..base import check
from ..base.extras import import_from_extra
from .grid import Grid
from .member import DONE, FAILED, PENDING, STATUS, MemberRecord
from .metrics import METRICS, Metrics

if TYPE_CHECKING:
    import xarray

_SECONDS_BETWEEN_WRITES = 1.0
_SHARE_OF_WRITES = 0.05  # largest part of the time that writing takes

ATTRIBUTE = "clothsim_sweep"
"""The attribute of Datasets and stores that identifies their sweep, as JSON text. Not "clothsim":
that is the accessor, which xarray would hide behind it.
"""

SCHEMA = 5
"""Version of the layout of a store, and of the attribute."""


class Results:
    """The variables of a sweep.

    Each has an entry for each member, and dimensions of its own behind that of members.
    `description` has the sweep's identity and provenance; `store` keeps them.
    """

    def __init__(
        self,
        grid: Grid,
        metrics: Metrics,
        description: Mapping[str, Any],
        store: Store | None = None,
    ) -> None:
        self.grid = grid
        self.store = store
        self._coordinates = grid.coordinates()
        self._attrs = {ATTRIBUTE: json.dumps(store.description if store else description)}
        self._variables: dict[str, tuple[tuple[str, ...], np.ndarray, Mapping[str, Any]]] = {}
        flags = {"flag_values": list(range(len(STATUS))), "flag_meanings": " ".join(STATUS)}
        self._add_variable(
            "status", np.int8, PENDING, {"long_name": "what became of the member", **flags}
        )
        self._add_variable(
            "max_stable_dt",
            float,
            np.nan,
            {"long_name": "guaranteed stable time step", "units": "s"},
        )
        self._add_variable(
            "unstable_step",
            np.int64,
            -1,
            {"long_name": "step at which it diverged, -1: never", "units": "1"},
        )
        self._add_variable(
            "unstable_time", float, np.nan, {"long_name": "time at which it diverged", "units": "s"}
        )
        self._add_variable(
            "message",
            object,
            "",
            {"long_name": "why a member did not come to its end, or has no error"},
        )
        for metric in [METRICS[name] for name, function in metrics.items() if function is None]:
            for name, (text, unit) in metric.variables.items():
                attrs = {"long_name": text}
                if unit:
                    attrs["units"] = unit
                if name == "stable":
                    self._add_variable(name, np.bool_, False, attrs)
                else:
                    self._add_variable(name, float, np.nan, attrs)
        dataset = None if store is None else store.read_values(self._variables)
        if dataset is not None:
            self._take_stored_values(dataset)

    def _take_stored_values(self, dataset: xarray.Dataset) -> None:
        """Take the values of a store."""
        for key, values in dataset.data_vars.items():
            name = str(key)
            if name not in self._variables:  # A user's function adds its own with the first result.
                own = values.dims[len(self.grid.shape) :]
                sizes = {str(dimension): values.sizes[dimension] for dimension in own}
                self._add_variable(name, float, np.nan, values.attrs, **sizes)
            self[name][...] = values.values.reshape(self[name].shape)

    def _add_variable(
        self, name: str, dtype: Any, fill: Any, attrs: Mapping[str, Any], **own: int
    ) -> None:
        """Add a variable; `own` has its own dimensions and their lengths."""
        if name in self._coordinates:
            raise ValueError(
                f"metrics: a function must not be named {name!r}, a coordinate of this sweep is"
            )
        self._variables[name] = (
            tuple(own),
            np.full((self.grid.size, *own.values()), fill, dtype),
            attrs,
        )

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values of a variable, with an entry for each member."""
        return self._variables[name][1]

    @property
    def members_to_run(self) -> np.ndarray:
        """Indices of the members to run: pending members and failed members."""
        return np.flatnonzero((self["status"] == PENDING) | (self["status"] == FAILED))

    def take_records(self, records: Sequence[MemberRecord]) -> None:
        """Take the results of members.

        Their status comes last, so that a member that is marked as done is complete.
        """
        columns: dict[str, dict[int, Any]] = {}
        for record in records:
            for name, value in record.values.items():
                columns.setdefault(name, {})[record.index] = value
        for name, values in columns.items():
            self._put_values(name, [*values], [*values.values()])
        for name in ("max_stable_dt", "unstable_step", "unstable_time", "message", "status"):
            array = self[name]
            for record in records:
                array[record.index] = getattr(record, name)

    def _put_values(self, name: str, indices: list[int], values: list[Any]) -> None:
        if name not in self._variables:
            own = {f"{name}_{k}": length for k, length in enumerate(np.shape(values[0]))}
            self._add_variable(name, float, np.nan, {"long_name": name.replace("_", " ")}, **own)
        array = self[name]
        shapes = {getattr(value, "shape", ()) for value in values} - {array.shape[1:]}
        if shapes:
            raise ValueError(
                f"metric {name!r} must give every member an array of one shape, got "
                f"{shapes.pop()} and {array.shape[1:]}"
            )
        array[indices] = values

    def write_to_store(self, final: bool = False) -> None:
        """Write the results to the store; unless `final`, only now and then."""
        if self.store is not None and (final or self.store.write_is_due):
            self.store.write_values(self.make_dataset())

    def make_dataset(self) -> xarray.Dataset:
        """Return the results as a Dataset."""
        variables = {}
        for name, (own, values, attrs) in self._variables.items():
            values = values.reshape((*self.grid.shape, *values.shape[1:]))
            variables[name] = ((*self.grid.dimensions, *own), values, attrs)
        xr = import_from_extra("xarray", "sweep")
        dataset: xarray.Dataset = xr.Dataset(variables, self._coordinates, self._attrs)
        return dataset


class Store:
    """The zarr group of one sweep at `path`, with a lock on its folder until `release_lock`.

    `description` has its identity. A ValueError refuses a folder that is not a store, is being
    written, or is of another sweep, with the differences.
    """

    def __init__(self, path: Path, description: Mapping[str, Any]) -> None:
        self.path = path
        self.description = description
        self._zarr = import_from_extra("zarr", "store=...")
        self._next_write = time.monotonic() + _SECONDS_BETWEEN_WRITES
        exists = (path / "zarr.json").exists()
        if not exists and path.exists() and any(path.iterdir()):
            raise ValueError(f"store {str(path)!r} is no store of a sweep")
        path.mkdir(parents=True, exist_ok=True)
        self._lock = _lock_folder(path)
        try:
            if exists:
                self.description = read_description(path)
                texts = list_differences(self.description["identity"], description["identity"])
                if len(texts) > 6:
                    texts = [*texts[:6], f"and {len(texts) - 6} more"]
                if texts:
                    raise ValueError(
                        f"store {str(path)!r} is of another sweep; it differs in {'; '.join(texts)}"
                    )
            else:
                self._zarr.create_group(
                    path, zarr_format=3, attributes={ATTRIBUTE: json.dumps(description)}
                )
        except BaseException:
            self.release_lock()
            raise

    def read_values(self, names: Iterable[str]) -> xarray.Dataset | None:
        """Read the values, with the variables `names`; None where nothing was written yet."""
        if not (self.path / "status" / "zarr.json").exists():
            return None
        return read_dataset(self.path, names)

    @property
    def write_is_due(self) -> bool:
        """Tell whether it is time to write."""
        return time.monotonic() >= self._next_write

    def write_values(self, dataset: xarray.Dataset) -> None:
        """Write all values, those of "status" last."""
        begin = time.monotonic()
        codecs = {"compressors": (self._zarr.codecs.ZstdCodec(), self._zarr.codecs.Crc32cCodec())}
        texts = {
            name: coordinate.astype(object)
            for name, coordinate in dataset.coords.items()
            if coordinate.dtype.kind == "U"
        }
        dataset = dataset.assign_coords(texts)
        for part in (dataset.drop_vars("status"), dataset[["status"]]):
            new = {
                name: codecs
                for name in part.variables
                if not (self.path / str(name) / "zarr.json").exists()
            }
            layout: dict[str, Any] = {
                "zarr_format": 3,
                "consolidated": False,
                "write_empty_chunks": True,
            }
            part.to_zarr(self.path, mode="a", encoding=new, **layout)
        end = time.monotonic()
        self._next_write = end + max(_SECONDS_BETWEEN_WRITES, (end - begin) / _SHARE_OF_WRITES)

    def release_lock(self) -> None:
        """Release the lock, in processes forked from this one too."""
        if self._lock is not None:
            fcntl.flock(self._lock, fcntl.LOCK_UN)
            os.close(self._lock)
            self._lock = None


def _lock_folder(path: Path) -> int | None:
    """Lock a folder, and return the lock's descriptor; None where the system has no locks."""
    if fcntl is None:
        return None
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        text = f"store {str(path)!r} is being written by a sweep"
        raise ValueError(f"{text}; wait for its end, or give another store") from None
    return handle


def read_description(path: Path) -> dict[str, Any]:
    """Read what the store at `path` says of its sweep; a ValueError refuses other folders."""
    try:
        attributes = json.loads((path / "zarr.json").read_bytes())["attributes"]
        description = dict(json.loads(attributes[ATTRIBUTE]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"store {str(path)!r} is no store of a sweep ({error})") from None
    if description.get("schema") != SCHEMA:
        raise ValueError(
            f"store {str(path)!r} has schema {description.get('schema')}, the version read here "
            f"is {SCHEMA}"
        )
    return description


def read_dataset(path: Path, names: Iterable[str] = ()) -> xarray.Dataset:
    """Read the values of a store, with the variables `names`.

    A ValueError names a variable that is damaged or lacks a chunk.
    """
    name = "status"
    try:
        group = import_from_extra("zarr", "a sweep's store").open_group(
            path, mode="r", use_consolidated=False
        )
        has_results = (group[name][...] == DONE).any()
        for name in sorted({*group.array_keys(), *names}):
            array = group[name]
            # zarr takes a chunk without a file for empty.
            if has_results and name != "status" and array.nchunks_initialized < array.nchunks:
                raise FileNotFoundError("a chunk is missing")
            array[...]  # zarr compares checksums here.
        xr = import_from_extra("xarray", "open_sweep")
        dataset: xarray.Dataset = xr.open_zarr(path, chunks=None, consolidated=False).load()
    except Exception as error:  # zarr raises many kinds.
        raise ValueError(
            f"store {str(path)!r} is damaged at {name} ({type(error).__name__}: {error}): delete it"
        ) from None
    for key, variable in dataset.variables.items():
        # NumPy's new text type breaks xarray's `where` and the like; the old ones do not.
        if variable.dtype.kind == "T":
            texts = variable.values.astype(object)
            if key != "message":
                texts = np.array(texts.tolist())
            dataset[key] = (variable.dims, texts, variable.attrs)
    return dataset


def list_differences(stored: Any, new: Any, path: str = "") -> list[str]:
    """List the differences of two plain values, as "path (value in the store, value given)"."""
    if isinstance(stored, list) and isinstance(new, list):
        stored = dict(enumerate(stored))
        new = dict(enumerate(new))
    if isinstance(stored, dict) and isinstance(new, dict):
        texts = []
        for key in {**stored, **new}:
            texts += list_differences(stored.get(key), new.get(key), f"{path}.{key}".lstrip("."))
        return texts
    stored_text = json.dumps(stored)
    new_text = json.dumps(new)
    if stored_text == new_text:
        return []
    return [f"{path} ({stored_text:.60} in the store, {new_text:.60} given)"]


@check.check_names
def open_sweep(path: str | os.PathLike[str]) -> xarray.Dataset:
    """Read the store of a sweep, finished or not.

    Parameters
    ----------
    path : path-like
        The ``store`` of `sweep`.

    Returns
    -------
    xarray.Dataset
        As `sweep` returns it.

    Raises
    ------
    ValueError
        If `path` is not the store of a sweep, or a chunk is damaged or missing, which the message
        names.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0, 2.0]}, duration=0.1,
    ...                     dt=0.01, metrics="stable", progress=False,
    ...                     store=folder + "/s.zarr")
    ...     again = cs.open_sweep(folder + "/s.zarr")
    >>> bool(again.stable.all())
    True
    """
    import_from_extra("xarray", "open_sweep")
    import_from_extra("zarr", "a sweep's store")
    path = check.path("path", path)
    if not path.is_dir():
        raise ValueError(f"path must be the folder of a store, got {str(path)!r}")
    read_description(path)
    if not (path / "status" / "zarr.json").exists():
        raise ValueError(f"path {str(path)!r} is a store that was stopped before it had anything")
    return read_dataset(path)
