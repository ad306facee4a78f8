"""A finished run: its frames, its report, its measures over frames, and files of it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base import files as _files
from ..base.extras import needed
from ..engine import snapshot
from ..engine.snapshot import Snapshot
from ..measure.measures import energy, largest_stretch, penetration
from ..model.scene import Scene
from ..typing import Every, Report
from .displayed import DisplayedRun
from .exported import ExportedRun
from .lines import run_lines
from .recording import Continuation
from .selected import SelectedRun

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Run(SelectedRun, DisplayedRun, ExportedRun):
    """Frames, report and final state of a run; `simulate` returns it.

    ``print(run)`` gives six lines, ``len(run)`` the number of frames, and ``run[10:20]`` a run of these frames. Two
    runs are equal if their scenes, times and frames are equal bit for bit; the report, which has measured times, does
    not count. The hash agrees with that as long as the arrays are unchanged.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the stored frames [s], shape (frames,).
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s], float64, shape (frames, rows, columns, 3).
    report : dict
        See `simulate`; its type is `clothsim.typing.Report`.
    snapshot : Snapshot or None
        The final state with all its digits, from which `resume` and ``Stepper.restore`` continue.
    continuation : object or None
        Settings of the steps, for `resume`.

    Examples
    --------
    >>> import clothsim as cs
    >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
    >>> run.x.shape, run.report["steps"]
    ((6, 32, 32, 3), 100)
    """

    scene: Scene
    t: Floats
    x: Floats
    v: Floats
    report: Report
    snapshot: Snapshot | None = None
    continuation: Continuation | None = None

    if TYPE_CHECKING:  # frames of a user's own have an empty report

        def __init__(
            self,
            scene: Scene,
            t: Floats,
            x: Floats,
            v: Floats,
            report: Report | dict[str, Any],
            snapshot: Snapshot | None = None,
            continuation: Continuation | None = None,
        ) -> None: ...

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Run):
            return NotImplemented
        if self is other:
            return True
        pairs = ((self.t, other.t), (self.x, other.x), (self.v, other.v))
        return self.scene == other.scene and all(np.array_equal(*pair) for pair in pairs)

    def __hash__(self) -> int:
        return hash((self.x.shape, self.t.tobytes()))

    def __repr__(self) -> str:
        adaptive = self.continuation is not None and self.continuation.dt is None
        return "\n".join(run_lines(self.scene, self.t, self.report, adaptive))

    def resume(
        self,
        duration: float,
        *,
        every: Every | None = None,
        times: npt.ArrayLike | None = None,
        fps: float | None = None,
        callback: Callable[[float, Any, Any], Any] | None = None,
        progress: bool = False,
    ) -> Run:
        """Continue from the end of this run, with its settings.

        With a time step that divides the first duration, the result has the bits of one run of both durations. Else the
        last step of the first run is shorter. The result continues the compensation of "single". `save`
        and `load_run` keep all that is needed.

        With error control, the method, the tolerance of a step and the step size continue. If a callback or Ctrl-C
        ended the run at a step, the result has the bits of the uninterrupted run to that end. A whole run shortens its
        last steps to end at its duration, so one run of both durations has other steps. The error at the new end is not
        estimated.

        Parameters
        ----------
        duration : float
            Simulated time to add [s], > 0.
        every, times, fps
            Frames, as for `simulate`. Default: the schedule of this run, counted from its start.
        callback, progress
            As for `simulate`.

        Returns
        -------
        Run
            A run whose first frame is the last frame of this run.

        Raises
        ------
        ValueError, TypeError
            If an argument is not as above, or this run has no `snapshot`.
        UnstableError, ContactError, RunInterrupted
            As for `simulate`.

        Examples
        --------
        >>> import clothsim as cs
        >>> scene = cs.scenes.paper_moving()
        >>> run = cs.simulate(scene, 0.02, dt=1e-4)
        >>> more = run.resume(0.03)
        >>> float(more.t[0]), float(more.t[-1])
        (0.02, 0.05)
        >>> whole = cs.simulate(scene, 0.05, dt=1e-4)
        >>> bool((more.x[-1] == whole.x[-1]).all())
        True
        """
        from .simulate import resume

        return resume(self, duration, every, times, fps, callback, progress)

    def energy(self) -> dict[str, Floats]:
        """Energies of the frames.

        Returns
        -------
        dict
            "kinetic", "elastic", "gravity", "force" and "total" [J], arrays of shape (frames,); see
            `clothsim.energy`.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.oscillator(), 1.0, dt=1e-3, fps=10)
        >>> total = run.energy()["total"]
        >>> total.shape, bool(abs(total - total[0]).max() < 1e-9)
        ((11,), True)
        """
        found = [energy(self.scene, *one) for one in zip(self.x, self.v)]  # Ctrl-C acts between two frames
        return {name: np.array([one[name] for one in found]) for name in found[0]}

    def penetration(self, sphere: int | None = None) -> dict[str, Floats]:
        """How deep the cloth is inside the spheres, each at its place at the time of the frame.

        Parameters
        ----------
        sphere : int, optional
            Index into ``scene.spheres``. Default: the deepest over all spheres.

        Returns
        -------
        dict
            "points" and "triangles": depths [m] below the true radius, >= 0, arrays of shape
            (frames,); 0 without spheres. See `clothsim.penetration`. ``report["penetration"]`` is
            that of the whole run, not only of the frames.

        Raises
        ------
        ValueError, TypeError
            If there is no such sphere.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_moving(), 0.1, dt=1e-3, fps=50)
        >>> run.penetration()["points"]
        array([0., 0., 0., 0., 0., 0.])
        """
        spheres = self.scene.spheres
        if sphere is not None:
            last = len(spheres) - 1
            if last < 0:
                raise ValueError(f"sphere must be None for a scene without spheres, got {check.shown(sphere)}")
            spheres = (spheres[check.integer("sphere", sphere, minimum=0, maximum=last)],)
        deepest = {name: np.zeros(len(self.t)) for name in ("points", "triangles")}
        for one in spheres:
            for name, depth in penetration(self.x, one, self.t).items():
                np.maximum(deepest[name], depth, out=deepest[name])
        return deepest

    def stretch(self) -> dict[str, Floats]:
        """Stretch of the most stretched spring of each frame.

        Returns
        -------
        dict
            "largest": l / L - 1, an array of shape (frames,); see `clothsim.largest_stretch`.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> bool(run.stretch()["largest"][-1] > 0)
        True
        """
        return {"largest": np.asarray(largest_stretch(self.scene, self.x))}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the run, with its scene, report and final state, to a file for `load_run`.

        Parameters
        ----------
        path : path-like
            Ends in ".npz", which is added where there is no ending. An existing file is replaced.

        Returns
        -------
        pathlib.Path
            The file written.

        Raises
        ------
        ValueError
            For any other ending, or if the arrays or the report are not those of a run of the scene.

        Examples
        --------
        >>> import tempfile, clothsim as cs
        >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.save(folder + "/run").name
        'run.npz'
        """
        path = _files.npz_path(path)
        _check_arrays(self)
        texts = {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)}
        if self.snapshot is not None and self.continuation is not None:
            texts |= snapshot.to_arrays(self.snapshot)
            texts["continuation"] = json.dumps(self.continuation.to_dict())
        return _files.write_npz(path, {"t": self.t, "x": self.x, "v": self.v, **texts})

    def to_xarray(self) -> xarray.Dataset:
        """The run as an `xarray.Dataset` with the dimensions time, row, column and component.

        Raises
        ------
        ImportError
            Without xarray, naming the extra that brings it.

        Examples
        --------
        >>> import clothsim as cs
        >>> run = cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3, fps=50)
        >>> dict(run.to_xarray().sizes)
        {'time': 6, 'row': 1, 'column': 2, 'component': 3}
        """
        xr = needed("xarray", "to_xarray")
        dimensions = ("time", "row", "column", "component")
        dataset: xarray.Dataset = xr.Dataset(
            {"position": (dimensions, self.x, {"units": "m"}), "velocity": (dimensions, self.v, {"units": "m/s"})},
            {"time": ("time", self.t, {"units": "s"}), "component": ["x", "y", "z"]},
            {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)},
        )
        return dataset


def load_run(path: str | os.PathLike[str]) -> Run:
    """Read a run that `Run.save` wrote. Nothing in the file is executed.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If the file is no run, or is damaged.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile, clothsim as cs
    >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = cs.load_run(run.save(folder + "/run"))
    >>> again == run
    True
    """
    data = _files.read_npz(path, "run", ("t", "x", "v", "scene", "report"))
    with _files.reading(path, "run"):
        scene = Scene.from_dict(json.loads(str(data["scene"])))
        report = json.loads(str(data["report"]))
        final = continuation = None
        if "continuation" in data:
            continuation = Continuation.from_dict(json.loads(str(data["continuation"])))
            final = snapshot.from_arrays(data)
        found = Run(scene, data["t"], data["x"], data["v"], report, final, continuation)
        _check_arrays(found)
        return found


def _check_arrays(run: Run) -> None:
    """Raise a ValueError where times, frames, report or final state do not fit the scene or each other."""
    shape = (len(run.t), *run.scene.cloth.shape, 3) if run.t.ndim == 1 else ()
    for name, array, expected in (("t", run.t, shape[:1]), ("x", run.x, shape), ("v", run.v, shape)):
        if array.dtype != np.float64 or array.shape != expected or not array.size:
            raise ValueError(
                f"{name} must be float64 of shape {expected or '(frames,)'}, got {array.dtype} of shape {array.shape}"
            )
        check.check_all(name, array, np.isfinite(array), "finite numbers")
    check.check_all("t", run.t, np.diff(run.t, prepend=-np.inf) > 0, "increasing times")
    if not isinstance(run.report, dict):
        raise ValueError(f"report must be a mapping, got {check.shown(run.report)}")
    missing = Report.__annotations__.keys() - run.report.keys()
    if missing and run.continuation is not None:  # a run made by hand knows less
        raise ValueError(f"report lacks {', '.join(sorted(missing))}")
    if run.snapshot is not None and run.snapshot.scene != run.scene:
        raise ValueError("its final state is of another scene")
