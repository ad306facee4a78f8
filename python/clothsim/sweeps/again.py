"""Compute a member of a finished sweep again, from its Dataset, as a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import check
from ..errors import ContactError, UnstableError
from ..model.motion import motion_from_dict
from ..model.scene import Scene
from ..run.frames import as_every, checked_every
from ..run.result import Run
from ..run.simulate import simulate
from .grid import Axis, Grid
from .member import Member, Settings

if TYPE_CHECKING:
    import xarray


def member_run(dataset: xarray.Dataset, identity: Mapping[str, Any], selection: Mapping[str, Any], every: Any) -> Run:
    """The only member of `dataset` after `selection`, with frames by `every`."""
    given = identity["settings"]
    every = given["every"] if every is None else checked_every(every)
    settings = Settings(**{**given, "metrics": (), "every": every})
    grid = Grid([_axis(entry) for entry in identity["over"]])
    index = _index(grid, _selected(dataset, selection))
    member = Member.make(index, Scene.from_dict(identity["scene"]), grid.member(index), settings)
    steps: dict[str, Any] = {"rtol": member.rtol, "atol": member.atol} if member.controlled else {"dt": member.dt}
    try:
        return simulate(
            member.scene, member.duration, every=as_every(every), sampling=settings.sampling, **member.numerics, **steps
        )
    except (UnstableError, ContactError) as error:
        if not isinstance(error.run, Run):
            raise
        return error.run


def _selected(dataset: xarray.Dataset, selection: Mapping[str, Any]) -> xarray.Dataset:
    """The part of `dataset` with these labels; a KeyError names a wrong dimension or label, and the accepted ones."""
    for name, label in selection.items():
        if name not in dataset.dims:
            raise KeyError(f"this sweep has the dimensions {', '.join(map(str, dataset.dims)) or 'none'}, got {name!r}")
        labels = dataset[name].values
        if np.ndim(label) == 0 and not isinstance(label, slice) and label not in labels.tolist():
            raise KeyError(
                f"{name} must be one of its {len(labels)} labels, from {labels[0]!s} to {labels[-1]!s}, got {label!r}; "
                f'ds.sel({name}=..., method="nearest").clothsim.member() takes the nearest'
            )
    return dataset.sel(dict(selection))


def _axis(entry: Mapping[str, Any]) -> Axis:
    """The axis that `Grid.describe` described."""
    columns = {name: [_value(name, value) for value in values] for name, values in entry["values"].items()}
    places = tuple(dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    labels = entry.get("labels")
    return Axis(entry["dimension"], places, None if labels is None else tuple(labels))


def _value(name: str, value: Any) -> Any:
    """A swept value from its plain form."""
    if isinstance(value, Mapping) and "sha256" in value:
        raise ValueError(f"a member cannot be run again where {name} is swept over arrays, which a Dataset does not keep")
    if name == "scene":
        return Scene.from_dict(value)
    if name.endswith("motion") and value is not None:
        return motion_from_dict(value)
    return value


def _index(grid: Grid, chosen: xarray.Dataset) -> int:
    """The number of the only member in `chosen`."""
    coordinates = {one.name: one.values for one in grid.coordinates()}
    place = []
    for axis in grid.axes:
        name = axis.dimension
        if name not in chosen.coords:
            raise ValueError(f"a member needs the coordinate {name!r} of its Dataset: select without drop=True")
        left = chosen[name]
        if left.size != 1:
            raise ValueError(f"a member needs one value of {name!r}, got {left.size}: give member({name}=...)")
        (found,) = np.flatnonzero(coordinates[name] == check.as_array(name, left.values, "one value").ravel()[0])
        place.append(int(found))
    return int(np.ravel_multi_index(place, grid.shape)) if place else 0
