"""Results in memory, as arrays over the grid; `store` also keeps them on disk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..model.scene import Scene
from ..run.frames import Schedule
from .grid import Coordinate, Grid
from .member import FAILED, PENDING, STATUS, Record, Settings

FRAMES = ("position", "velocity")
"""The variables that have the frames of every member."""

SESSIONS = "sessions"
"""Beside the variables a store has this: where they come from."""


@dataclass
class Variable:
    """A variable of the result over the grid, with further dimensions of its own at the end."""

    name: str
    values: np.ndarray
    attrs: dict[str, Any] = field(default_factory=dict)
    more: tuple[str, ...] = ()
    fill: Any = np.nan  # of members that have no value

    @cached_property
    def by_member(self) -> np.ndarray:
        """A view of `values` by the member's index; not for frames on disk."""
        own = self.values.ndim - len(self.more)
        return self.values.reshape(math.prod(self.values.shape[:own]), *self.values.shape[own:])


class Results:
    """The variables of a sweep.

    The status of a member is set last, so a member that is marked as done is always complete.
    """

    def __init__(self, grid: Grid, settings: Settings, scene: Scene) -> None:
        self.grid, self.settings, self.scene = grid, settings, scene
        self.variables: dict[str, Variable] = {}
        self.coordinates: list[Coordinate] = grid.coordinates()
        self._open_variables()
        if settings.frames:
            self._open_frames()

    def _open_variables(self) -> None:
        self._add("status", np.int8, PENDING, _status_attrs())
        self._add("max_stable_dt", float, np.nan, _attrs("guaranteed stable time step", "s"))
        self._add("unstable_step", np.int64, -1, _attrs("step at which it diverged, -1: never", "1"))
        self._add("unstable_time", float, np.nan, _attrs("time at which it diverged", "s"))
        self._add("message", object, "", {"long_name": "why a member did not come to its end, or has no error"})
        for metric in self.settings.metrics:
            for name, attrs in metric.variables.items():
                dtype, fill = (np.bool_, False) if name == "stable" else (float, np.nan)
                self._add(name, dtype, fill, dict(attrs))

    def _open_frames(self) -> None:
        settings = self.settings
        frames = Schedule.of_every(settings.every).in_seconds(settings.dt or math.inf)
        times = np.array([t for _, t in frames.moments(0.0, settings.duration)])
        rows, columns = self._largest_shape()
        dims = ("time", "row", "column", "component")
        for name, unit in zip(FRAMES, ("m", "m/s"), strict=True):
            shape = (len(times), rows, columns, 3)
            self._add(name, float, np.nan, _attrs(f"{name} of the mass points", unit), dims, shape)
        self.coordinates.append(Coordinate("time", "time", times, {"units": "s"}))
        names = np.array(["x", "y", "z"])
        self.coordinates.append(Coordinate("component", "component", names, {}))

    def _largest_shape(self) -> tuple[int, int]:
        shapes = {self.scene.cloth.shape}
        for axis in self.grid.axes:
            if "shape" in axis.names:
                shapes = {tuple(shape) for shape in axis.column("shape")}
            if "scene" in axis.names:
                shapes = {scene.cloth.shape for scene in axis.column("scene")}
        return max(rows for rows, _ in shapes), max(columns for _, columns in shapes)

    def _add(
        self,
        name: str,
        dtype: Any,
        fill: Any,
        attrs: Mapping[str, Any],
        more: tuple[str, ...] = (),
        more_shape: tuple[int, ...] = (),
    ) -> None:
        taken = {*self.grid.dimensions, *(c.name for c in self.coordinates)}
        if name == SESSIONS:
            raise ValueError(f"metrics: a function must not be named {name!r}, a store has that")
        if name in taken:
            raise ValueError(f"metrics: a function must not be named {name!r}, a coordinate of this sweep is")
        values = self._allocate(name, (*self.grid.shape, *more_shape), dtype, fill)
        self.variables[name] = Variable(name, values, dict(attrs), more, fill)

    def _allocate(self, name: str, shape: tuple[int, ...], dtype: Any, fill: Any) -> np.ndarray:
        return np.full(shape, fill, dtype)

    @property
    def pending(self) -> np.ndarray:
        """Indices of the members to run: pending members and failed members."""
        status = self.variables["status"].values.ravel()
        return np.flatnonzero((status == PENDING) | (status == FAILED))

    def count(self, status: str) -> int:
        return int((self.variables["status"].values == STATUS.index(status)).sum())

    def record(self, record: Record) -> None:
        """Store the result of a member."""
        for name, value in record.values.items():
            if name not in self.variables:
                self._add_function(name, np.asarray(value))
            self._set(name, record.index, value)
        if record.frames is not None:
            place = tuple(int(k) for k in np.unravel_index(record.index, self.grid.shape))
            for name, frames in zip(FRAMES, record.frames, strict=True):
                self._set_frames(name, place, frames)
        for name in ("max_stable_dt", "unstable_step", "unstable_time", "message"):
            self._set(name, record.index, getattr(record, name))
        self._set("status", record.index, record.status)

    def _add_function(self, name: str, value: np.ndarray) -> None:
        dims = tuple(f"{name}_{k}" for k in range(value.ndim))
        self._add(name, float, np.nan, {"long_name": name.replace("_", " ")}, dims, value.shape)

    def _set(self, name: str, index: int, value: Any) -> None:
        places = self.variables[name].by_member
        if np.shape(value) != places.shape[1:]:
            raise ValueError(
                f"metric {name!r} must give every member an array of one shape, got {np.shape(value)} and {places.shape[1:]}"
            )
        before = places[index]
        if places.ndim > 1 or (value != before and not (value != value and before != before)):
            places[index] = value
            self._changed(name, index)

    def _changed(self, name: str, index: int) -> None:
        """Called after a member's value of a variable has changed. In memory there is nothing to do."""

    def _set_frames(self, name: str, place: tuple[int, ...], frames: np.ndarray) -> None:
        rows, columns = frames.shape[1:3]
        inside: Any = (*place, slice(None), slice(rows), slice(columns))
        self.variables[name].values[inside] = frames

    def prepare(self) -> None:
        """Prepare for the first result, while the first members are computed."""

    def flush(self, final: bool = False) -> None:
        """Write pending results. In memory there is nothing to do."""

    def close(self) -> None:
        """End writing."""


def _attrs(long_name: str, units: str) -> dict[str, Any]:
    return {"long_name": long_name, "units": units}


def _status_attrs() -> dict[str, Any]:
    return {
        "long_name": "what became of the member",
        "flag_values": list(range(len(STATUS))),
        "flag_meanings": " ".join(STATUS),
    }
