"""Results in memory, as arrays over the grid, and as a Dataset; `store` also keeps them on disk."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Floats
from ..base.extras import needed
from ..model.scene import Scene
from ..run.frames import Schedule
from .grid import Coordinate, Grid
from .member import FAILED, PENDING, STATUS, Record, SweepOptions

if TYPE_CHECKING:
    import xarray

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
        more = dict(zip(("time", "row", "column", "component"), (len(times), *self._largest_shape(), 3), strict=True))
        for name, unit in zip(FRAMES, ("m", "m/s"), strict=True):
            self._add(name, float, np.nan, {"long_name": f"{name} of the mass points", "units": unit}, more)
        self.coordinates.append(Coordinate("time", "time", times, {"units": "s"}))
        self.coordinates.append(Coordinate("component", "component", np.array(["x", "y", "z"])))

    def _largest_shape(self) -> tuple[int, int]:
        swept = [(name, value) for axis in self.grid.axes for place in axis.places for name, value in place.items()]
        shapes = [value for name, value in swept if name == "shape"]
        shapes += [value.cloth.shape for name, value in swept if name == "scene"]
        rows, columns = zip(*(shapes or [self.scene.cloth.shape]), strict=True)
        return max(rows), max(columns)

    def _add(
        self, name: str, dtype: Any, fill: Any, attrs: Mapping[str, Any], more: Mapping[str, int] = MappingProxyType({})
    ) -> None:
        """Add a variable; `more` has its own dimensions and their lengths."""
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
        self._add(name, float, np.nan, {"long_name": name.replace("_", " ")}, more)

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
