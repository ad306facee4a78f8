"""`Dataset.clothsim`: plots and provenance of a sweep."""

from __future__ import annotations

import json
from typing import Any

import xarray

from ..scene import Scene
from .attribute import ATTRIBUTE, OLD_ATTRIBUTE


def _plots() -> Any:
    # Here, so that `import xarray` waits for no more than the accessor.
    from . import plots

    return plots


class Plots:
    """`Dataset.clothsim.plot`: call it, or one of its kinds; see `clothsim.sweep.plots`."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    def __call__(self, kind: str | None = None, **options: Any) -> Any:
        """What fits best, or the named kind: "convergence", "stability" or "heatmap"."""
        return _plots().plot(self._dataset, kind, **options)

    def convergence(self, **options: Any) -> Any:
        """Error over dt, a line for each value of another dimension."""
        return _plots().convergence(self._dataset, **options)

    def stability(self, **options: Any) -> Any:
        """Which members came to their end, with the guaranteed stable time step."""
        return _plots().stability(self._dataset, **options)

    def heatmap(self, variable: str | None = None, **options: Any) -> Any:
        """A metric over two dimensions."""
        return _plots().heatmap(self._dataset, variable, **options)


@xarray.register_dataset_accessor("clothsim")
class ClothsimAccessor:
    """What a sweep's Dataset can tell beyond its variables.

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

    @property
    def scene(self) -> Scene:
        """The scene that the members are variations of."""
        return Scene.from_dict(self.provenance["identity"]["scene"])
