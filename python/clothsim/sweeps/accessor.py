"""`Dataset.clothsim`: plots of all results, provenance and members of a sweep."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import xarray

from ..base.services import find_service
from ..errors import ContactError, UnstableError
from ..model.motion import motion_from_dict
from ..model.scene import Scene
from ..model.wind import Wind
from ..run.result import Run
from ..run.simulate import simulate
from ..typing import Force
from .grid import Axis, Grid
from .member import MemberMaker, SweepOptions
from .store import ATTRIBUTE


@xarray.register_dataset_accessor("clothsim")
class ClothsimAccessor:
    """Methods of a sweep's Dataset."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def plot(self, kind: str | None = None, **options: Any) -> Any:
        """Draw a Dataset of this package and return the axes.

        Parameters
        ----------
        kind : {"convergence", "stability", "heatmap"}, optional
            The plot of a sweep. Default: the one that suits it best. A Dataset of `stability_map`,
            `work_precision` or `sensitivity` has one plot.
        **options
            `ax`, axes of matplotlib: one for a sweep and `stability_map`, one or two for
            `work_precision`, two a parameter for `sensitivity`; default: those of a new figure. Of
            a sweep also `along`, the dimension of the lines of "convergence"; `y` of "stability";
            `variable`, `x` and `y` of "heatmap".

        Examples
        --------
        >>> over = {"dt": [0.01, 0.02, 0.04]}
        >>> ds = cs.sweep(cs.scenes.oscillator(), over, duration=0.4, progress=False)
        >>> ds.clothsim.plot("heatmap", variable="largest_stretch").get_ylabel()
        'largest stretch [%]'
        >>> ds = cs.sensitivity(cs.scenes.oscillator(), [0.1, 0.2], of=["stiffness"])
        >>> ds.clothsim.plot().shape
        (1, 2)
        """
        return find_service("plot")(self._dataset, kind, **options)

    @property
    def provenance(self) -> dict[str, Any]:
        """Origin of the sweep.

        It has the "identity" (scene, grid, settings, version), and "created", "build" and "machine"
        of the first call.
        """
        text = self._dataset.attrs.get(ATTRIBUTE)
        if text is None:
            raise ValueError(
                f"this Dataset is of no sweep: it lacks the attribute {ATTRIBUTE!r}, which "
                "`sweep` and `open_sweep` give"
            )
        return dict(json.loads(text))

    def member(
        self, *, every: float | None = None, force: Force | None = None, **selection: Any
    ) -> Run:
        """Compute the `Run` of a member again, with equal bits, to show, play and export it.

        `every` is as for `simulate`; default: that of the sweep. `force` is that of the sweep,
        which keeps no function. `selection` has labels as for ``Dataset.sel``, one for each
        remaining dimension. The run of an unstable member ends at the last good state. Raises a
        ValueError if more than one member is selected, or the Dataset does not keep a swept array
        because of its size.

        Examples
        --------
        >>> over = {"stiffness": [1.0, 4.0]}
        >>> ds = cs.sweep(cs.scenes.oscillator(), over, duration=0.1, dt=0.01, progress=False)
        >>> run = ds.clothsim.member(stiffness=4.0, every=0.05)
        >>> run.scene.cloth.family_stiffness["structural"], run.t.tolist()
        (4.0, [0.0, 0.05, 0.1])
        """
        identity = self.provenance["identity"]
        settings = dict(identity["settings"])
        del settings["metrics"]
        if settings["force"] is not None and force is None:
            raise ValueError(
                f"force must be given: the sweep had {settings['force']}, and functions are not "
                "kept"
            )
        settings["force"] = force
        if every is not None:
            settings["every"] = every
        grid = Grid([_axis_from_data(entry) for entry in identity["over"]])
        indices = self._dataset.sel(selection)["member"]
        for name, size in indices.sizes.items():
            if size != 1:
                raise ValueError(
                    f"a member needs one value of {name!r}, got {size}: give member({name}=...)"
                )
        index = indices.item()
        make = MemberMaker(Scene.from_dict(identity["scene"]), SweepOptions(**settings))
        member = make(index, grid.member_values(index))
        options = {**member.settings, "dt": member.dt}
        try:
            return simulate(member.scene, every=settings["every"], **options)
        except (UnstableError, ContactError) as error:
            if not isinstance(error.run, Run):
                raise
            return error.run

    @property
    def scene(self) -> Scene:
        """The scene that the members are variations of."""
        return Scene.from_dict(self.provenance["identity"]["scene"])


def _axis_from_data(entry: Mapping[str, Any]) -> Axis:
    """Make an axis from its plain data, as `Grid.plain_axes` returns it."""
    columns = [
        [_swept_value_from_data(name, value) for value in values]
        for name, values in entry["values"].items()
    ]
    places = tuple(
        dict(zip(entry["values"], row, strict=True)) for row in zip(*columns, strict=True)
    )
    return Axis(entry["dimension"], places, tuple(entry["labels"]) if "labels" in entry else None)


def _swept_value_from_data(name: str, value: Any) -> Any:
    """Make a swept value from its plain form."""
    if isinstance(value, Mapping) and "sha256" in value:
        raise ValueError(
            f"a member cannot be run again where {name} is swept over arrays, which a "
            "Dataset does not keep"
        )
    if name == "scene":
        return Scene.from_dict(value)
    if name == "wind" and value is not None:
        return Wind.from_dict(value)
    if name.endswith("motion") and value is not None:
        return motion_from_dict(value)
    return value
