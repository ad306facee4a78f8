"""`Dataset.clothsim`: plots of all results, provenance and members of a sweep."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray

from ..errors import ContactError, UnstableError
from ..model.motion import motion_from_dict
from ..model.scene import Scene
from ..run.frames import as_every
from ..run.result import Run
from ..run.simulate import simulate
from ..typing import Every
from .grid import Axis, Grid
from .member import Maker, SweepOptions
from .store import ATTRIBUTE


@xarray.register_dataset_accessor("clothsim")
class ClothsimAccessor:
    """Methods of a sweep's Dataset."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def plot(self, kind: str | None = None, **options: Any) -> Any:
        """Draw the plot that suits the sweep best, or the named kind: "convergence", "stability" or "heatmap".

        A Dataset of `stability_map` or `work_precision` has one plot. `ax` may be given: axes of matplotlib, one or two of
        them for `work_precision`. The axes are returned.
        """
        from ..viewing.plots import plot

        return plot(self._dataset, kind, **options)

    @property
    def provenance(self) -> dict[str, Any]:
        """The "identity" (scene, grid, settings, version) and the "sessions" (machine, wall time, instruction sets)."""
        text = self._dataset.attrs.get(ATTRIBUTE)
        if text is None:
            raise ValueError(
                f"this Dataset is of no sweep: it lacks the attribute {ATTRIBUTE!r}, which `sweep` and `open_sweep` give"
            )
        return dict(json.loads(text))

    def member(self, *, every: Every | None = None, **selection: Any) -> Run:
        """The `Run` of one member, to show, play and export, computed again with equal bits.

        `every` is as for `simulate`; default: that of the sweep. `selection` has labels as for ``Dataset.sel``, one for
        each remaining dimension. The run of an unstable member ends at the last good state. Raises a ValueError if more
        than one member is selected, or the Dataset does not keep a swept array because of its size.

        Examples
        --------
        >>> ds = cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0, 4.0]}, duration=0.1, dt=0.01, progress=False)
        >>> run = ds.clothsim.member(stiffness=4.0, every=0.05)
        >>> run.scene.cloth.family_stiffness["structural"], run.t.tolist()
        (4.0, [0.0, 0.05, 0.1])
        """
        identity = self.provenance["identity"]
        given = identity["settings"]
        every = as_every(given["every"]) if every is None else every
        options = SweepOptions(**{**given, "metrics": (), "every": every})
        grid = Grid([_axis(entry) for entry in identity["over"]])
        index = _index(grid, self._dataset.sel(selection))
        member = Maker(Scene.from_dict(identity["scene"]), options)(index, grid.members([index])[index])
        try:
            return simulate(member.scene, member.settings.duration, every=every, **member.arguments)
        except (UnstableError, ContactError) as error:
            if not isinstance(error.run, Run):
                raise
            return error.run

    @property
    def scene(self) -> Scene:
        """The scene that the members are variations of."""
        return Scene.from_dict(self.provenance["identity"]["scene"])


def _axis(entry: Mapping[str, Any]) -> Axis:
    """The axis that `Grid.describe` described."""
    columns = [[_value(name, value) for value in values] for name, values in entry["values"].items()]
    places = tuple(dict(zip(entry["values"], row, strict=True)) for row in zip(*columns, strict=True))
    return Axis(entry["dimension"], places, tuple(entry["labels"]) if "labels" in entry else None)


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
        (found,) = np.flatnonzero(coordinates[name] == np.asarray(left.values).ravel()[0])
        place.append(int(found))
    return int(np.ravel_multi_index(place, grid.shape)) if place else 0
