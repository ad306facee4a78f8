"""`Dataset.clothsim`: plots, provenance and members of a sweep."""

from __future__ import annotations

import json
from typing import Any

import xarray

from ..model.scene import Scene
from ..run.result import Run
from ..typing import Every
from . import sweep_plots
from .again import member_run
from .attribute import ATTRIBUTE, OLD_ATTRIBUTE


class Plots:
    """`Dataset.clothsim.plot`: call it, or call one of its kinds; see `clothsim.sweeps.sweep_plots`."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def __call__(self, kind: str | None = None, **options: Any) -> Any:
        """Best fit, or the named kind: "convergence", "stability" or "heatmap"."""
        return sweep_plots.plot(self._dataset, kind, **options)

    def convergence(self, **options: Any) -> Any:
        """Error over dt, a line for each value of another dimension."""
        return sweep_plots.convergence(self._dataset, **options)

    def stability(self, **options: Any) -> Any:
        """Members that reached their end, with the guaranteed stable time step."""
        return sweep_plots.stability(self._dataset, **options)

    def heatmap(self, variable: str | None = None, **options: Any) -> Any:
        """A metric over two dimensions."""
        return sweep_plots.heatmap(self._dataset, variable, **options)


@xarray.register_dataset_accessor("clothsim")
class ClothsimAccessor:
    """Methods of a sweep's Dataset.

    Attributes
    ----------
    plot : Plots
        ``ds.clothsim.plot()`` and its kinds.
    """

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset
        self.plot = Plots(dataset)

    @property
    def provenance(self) -> dict[str, Any]:
        """Scene, grid, settings and version ("identity"), and machine, instruction sets, wall time
        and tasks of every session that worked on it ("sessions")."""
        text = self._dataset.attrs.get(ATTRIBUTE, self._dataset.attrs.get(OLD_ATTRIBUTE))
        if text is None:
            raise ValueError(
                f"this Dataset is of no sweep: it lacks the attribute {ATTRIBUTE!r}, which `sweep` and `open_sweep` give"
            )
        return dict(json.loads(text))

    def member(self, *, every: Every | None = None, **selection: Any) -> Run:
        """The `Run` of one member, to show, play and export.

        The member is computed again from the scene and the settings of the sweep, and has equal bits. For an unstable
        member the result is the run up to the last good state.

        Parameters
        ----------
        every : int, float or "step", optional
            Frames, as for `simulate`. Default: `every` of the sweep.
        **selection
            Labels as for ``Dataset.sel``, one for each remaining dimension.

        Returns
        -------
        Run

        Raises
        ------
        KeyError
            If there is no such label; ``ds.sel(..., method="nearest").clothsim.member()`` takes
            the nearest.
        ValueError
            If more than one member is left, or a swept array is too large for the Dataset to keep.

        Examples
        --------
        >>> import clothsim as cs
        >>> ds = cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0, 4.0]}, duration=0.1,
        ...               dt=0.01, metrics="stable", progress=False)
        >>> run = ds.clothsim.member(stiffness=4.0, every=0.05)
        >>> run.scene.cloth.family_stiffness["structural"], run.t.tolist()
        (4.0, [0.0, 0.05, 0.1])
        """
        return member_run(self._dataset, self.provenance["identity"], selection, every)

    @property
    def scene(self) -> Scene:
        """The scene that the members are variations of."""
        return Scene.from_dict(self.provenance["identity"]["scene"])
