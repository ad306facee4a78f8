"""Results as a labelled xarray Dataset."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import check
from ..base.extras import needed
from ..base.keywords import suggests
from .attribute import ATTRIBUTE, OLD_ATTRIBUTE
from .results import Results
from .store import read_attrs

if TYPE_CHECKING:
    import xarray


def to_dataset(results: Results, attrs: dict[str, Any]) -> xarray.Dataset:
    """The Dataset of results that are in memory."""
    xr = needed("xarray", "sweep")
    dims = results.grid.dimensions
    dataset: xarray.Dataset = xr.Dataset(
        {name: ((*dims, *variable.more), variable.values, variable.attrs) for name, variable in results.variables.items()},
        {c.name: (c.dimension, c.values, c.attrs) for c in results.coordinates},
        {ATTRIBUTE: json.dumps(attrs)},
    )
    return dataset


@suggests
def open_sweep(path: str | os.PathLike[str]) -> xarray.Dataset:
    """Open the store of a sweep, finished or not.

    Parameters
    ----------
    path : path-like
        The ``store`` of `sweep`.

    Returns
    -------
    xarray.Dataset
        As `sweep` returns it. Values are read when they are used.

    Raises
    ------
    ValueError
        If `path` is no store of a sweep.
    ImportError
        Without xarray and zarr (the extra "sweep").

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = cs.sweep(cs.scenes.oscillator(), {"stiffness": [1.0, 2.0]}, duration=0.1,
    ...                     dt=0.01, metrics="stable", store=folder + "/s.zarr", progress=False)
    ...     again = cs.open_sweep(folder + "/s.zarr").load()
    >>> bool(again.stable.all())
    True
    """
    xr = needed("xarray", "open_sweep")
    path = check.path("path", path)
    if not path.is_dir():
        raise ValueError(f"path must be the folder of a store, got {str(path)!r}")
    attrs = read_attrs(path)
    variables = attrs.pop("variables", None)
    if variables is None:
        raise ValueError(f"path {str(path)!r} is a store that was stopped before it had anything")
    dataset: xarray.Dataset = xr.open_zarr(path, chunks=None, consolidated=False)
    labels = [name for name in dataset.variables if name in _coordinate_names(attrs)]
    dataset = dataset.set_coords(labels)[variables]
    # NumPy's new text type breaks xarray's `where` and the like; the old ones do not.
    for name, array in dataset.variables.items():
        if array.dtype.kind == "T":
            texts = array.values.astype(object)
            texts = texts if name == "message" else np.array(texts.tolist())
            dataset[name] = (array.dims, texts, array.attrs)
    dataset.attrs.pop(OLD_ATTRIBUTE, None)
    dataset.attrs[ATTRIBUTE] = json.dumps(attrs)
    return dataset


def _coordinate_names(attrs: dict[str, Any]) -> set[str]:
    """The names that are swept, and names of coordinates that accompany them."""
    grid = attrs["identity"]["over"]
    names = {name for axis in grid for name in axis["values"]}
    names |= {axis["dimension"] for axis in grid}
    return names | {"rows", "columns", "time", "component"}
