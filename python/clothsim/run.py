"""A finished run: its frames, its report, and files of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ._displayed import DisplayedRun
from ._exported import ExportedRun
from ._extras import needed
from ._keywords import suggests
from .scene import Scene


@dataclass(frozen=True)
class Run(DisplayedRun, ExportedRun):
    """What `simulate` returns.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the stored frames [s], shape (frames,).
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s], float64, shape (frames, rows, columns, 3).
    report : dict
        See `simulate`.
    """

    scene: Scene
    t: npt.NDArray[np.float64]
    x: npt.NDArray[np.float64]
    v: npt.NDArray[np.float64]
    report: dict[str, Any]

    def save(self, path: str | Path) -> Path:
        """Write the run, with its scene and report, to a .npz file that `load_run` reads.

        Parameters
        ----------
        path : path-like
            ".npz" is added where it lacks.

        Returns
        -------
        pathlib.Path
            The file written.
        """
        path = Path(path)
        if path.suffix != ".npz":
            path = path.with_name(path.name + ".npz")
        texts = {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)}
        np.savez_compressed(path, t=self.t, x=self.x, v=self.v, **texts)
        return path

    def to_xarray(self) -> Any:
        """The run as an `xarray.Dataset` with the dimensions time, row, column and component.

        Raises
        ------
        ImportError
            Without xarray, naming the extra that brings it.
        """
        xarray = needed("xarray", "to_xarray")
        dimensions = ("time", "row", "column", "component")
        return xarray.Dataset(
            {
                "position": (dimensions, self.x, {"units": "m"}),
                "velocity": (dimensions, self.v, {"units": "m/s"}),
            },
            {"time": ("time", self.t, {"units": "s"}), "component": ["x", "y", "z"]},
            {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)},
        )


@suggests
def load_run(path: str | Path) -> Run:
    """Read what `Run.save` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If the file is none of `Run.save`.

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = cs.load_run(run.save(folder + "/run"))
    >>> bool((again.x == run.x).all()), again.scene == run.scene
    (True, True)
    """
    with np.load(path) as data:
        missing = {"t", "x", "v", "scene", "report"} - set(data.files)
        if missing:
            raise ValueError(f"{path} is no run of clothsim: it lacks {sorted(missing)}")
        scene = Scene.from_dict(json.loads(str(data["scene"])))
        report = json.loads(str(data["report"]))
        return Run(scene, data["t"], data["x"], data["v"], report)
