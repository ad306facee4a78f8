"""A run: its frames, report, measures over frames, and files and pictures of it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check
from ..base import files as _files
from ..base.extras import import_from_extra
from ..base.services import find_service
from ..base.text import format_count, format_joules, format_quantity
from ..engine import snapshot
from ..engine.snapshot import Snapshot
from ..measure import energy, largest_stretch, penetration
from ..model.obstacle import Plane, Sphere
from ..model.scene import Scene, cloth_text, spheres_text
from ..typing import Force
from .frames import Frames
from .reasons import Reason
from .report import join_reports
from .trajectory import Continuation

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """Frames, report and final state of a run; `simulate` returns it.

    ``print(run)`` gives seven lines, ``len(run)`` the number of frames, ``run[10:20]`` a run of
    these frames, and ``run + run.resume(1.0)`` one run of both. Two runs are equal if their scenes,
    times and frames are equal bit for bit.

    Attributes
    ----------
    scene : Scene
    t : numpy.ndarray
        Times of the stored frames [s], shape (frames,).
    x, v : numpy.ndarray
        Positions [m] and velocities [m/s], float64, shape (frames, rows, columns, 3).
    report : dict
        Its keys are below.
    snapshot : Snapshot or None
        The final state with all its digits, from which `resume` and ``Stepper.restore`` continue.
    continuation : object or None
        Settings of the steps, for `resume`.

    Notes
    -----
    Every report has the same keys. A number that is not known is NaN, and its "reason" says why.
    With the backend "gpu" depths are those of frames, and most other extremes NaN (docs/gpu.md).

    =========================  =====================================================================
    "steps", "rejected_steps"  accepted and rejected steps
    "dt"                       the time step, the mean one of an adaptive method [s]
    "force_evaluations"        in total; "solution_evaluations": of this run alone, without more
                               accurate runs, and runs that were too coarse
    "wall_time"                of the run alone [s], as "steps_per_second"
    "stopped"                  "" for a whole run, else "callback", "interrupted", "unstable",
                               "contact" or "error": the force or the callback raised one
    "error_estimate"           "max" and "rms" [m] of the last positions over the mass points: the
                               distance from a better run (docs/integrators.md). If it is larger
                               than asked for, "reason" says why error control could not reduce it.
                               After a response of the paper's it is NaN: nearby states diverge
    "tolerance"                "asked" [m, rms], NaN without error control, and "reached": whether
                               the estimate is at most that
    "energy"                   "start" and "end", see `energy`; "gained" [J]: the largest excess of
                               the total over its start, or 0, at stored frames and at one state in
                               128 (in 16 with error control, or above `max_stable_dt`). Only an
                               error of the method can add energy, until a response after the step
                               changes it; afterwards it is NaN
    "force_work"               work of the argument `force` of `simulate` on the free mass points
                               [J], by the stages of the method
    "wind_work"                the same of `Scene.wind`
    "penetration"              "points" and "triangles" [m]: greatest depths over all spheres; see
                               `penetration`. Mass points are measured at every state, triangles at
                               sampled ones. "triangles" is never less than "points"
    "stretch"                  "largest": see `largest_stretch`; sampled
    "first_contact"            "time" [s]: end of the first step in which a response changed the
                               cloth
    "impulse"                  one (x, y, z) per sphere [N s]: minus the momentum that its responses
                               gave to the cloth; see `Stepper.impulses`. A resumed run counts its
                               own. "impulse_reason"
    "obstacle_work"            work on the cloth by the motion of each obstacle of response
                               "penalty" [J]; the reason of a NaN is "impulse_reason"
    "residual", "reason"       of `settle`
    "integrator", ...          "precision", "kernel", "threads", "backend", "instruction_set" (with
                               "gpu" the adapter) and "version" say how the run was computed;
                               "as_printed": whether a sphere responds as printed in the paper
    =========================  =====================================================================

    States are the initial state and that at the end of each step, after the responses. Sampled are
    stored frames and every n-th state, n = min(128, steps // 32); with error control every 16th,
    and where 1/32 of the duration has passed.

    Examples
    --------
    >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
    >>> run.x.shape, run.report["steps"]
    ((6, 32, 32, 3), 100)
    """

    scene: Scene
    t: Floats
    x: Floats
    v: Floats
    report: dict[str, Any]  # empty dictionary for frames of a user's own
    snapshot: Snapshot | None = None
    continuation: Continuation | None = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Run):
            return NotImplemented
        if self is other:
            return True
        pairs = ((self.t, other.t), (self.x, other.x), (self.v, other.v))
        return self.scene == other.scene and all(np.array_equal(*pair) for pair in pairs)

    def __hash__(self) -> int:
        return hash((self.x.shape, self.t.tobytes()))

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, frames: slice) -> Run:
        """Return a run of the frames in a slice, as ``run[10:20]`` or ``run[::2]``.

        The arrays are views, and the report stays that of the whole run.
        """
        if not isinstance(frames, slice):
            raise TypeError(
                f"frames must be a slice, as in run[10:20], got {check.value_text(frames)}"
            )
        chosen = range(len(self))[frames]
        if not chosen or chosen.step < 0:
            raise ValueError(
                f"frames must be a rising slice of 0 to {len(self)} with a frame in it, got "
                f"{frames}"
            )
        run = replace(self, t=self.t[frames], x=self.x[frames], v=self.v[frames])
        if chosen[-1] < len(self) - 1:
            run = replace(run, snapshot=None, continuation=None)
        return run

    def __add__(self, more: Run) -> Run:
        """Join this run and its continuation, `more`, whose first frame is the last of this run."""
        if not isinstance(more, Run):
            return NotImplemented
        ends = ((self.t[-1:], more.t[:1]), (self.x[-1:], more.x[:1]), (self.v[-1:], more.v[:1]))
        if self.scene != more.scene or not all(np.array_equal(*pair) for pair in ends):
            raise ValueError(
                "a run can only be added that goes on from the last frame of this run, as "
                "run.resume(duration)"
            )
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(more, name)[1:]])
            for name in ("t", "x", "v")
        }
        return replace(more, **arrays, report=join_reports(self.report, more.report))

    def __repr__(self) -> str:
        return "\n".join(_summary_lines(self))

    @check.check_names
    def resume(
        self,
        duration: float,
        *,
        every: float | None = None,
        times: npt.ArrayLike | None = None,
        fps: float | None = None,
        force: Force | None = None,
        callback: Callable[[float, Any, Any], Any] | None = None,
        progress: bool = False,
    ) -> Run:
        """Continue from the end of this run, with its settings.

        With a time step that divides the first duration, the result has the bits of one run of both
        durations. With error control, the method, the tolerance of a step and the step size
        continue. The bits are those of one run where a callback or Ctrl-C ended the first at a
        step; a whole run shortens its last steps to end at its duration.

        Parameters
        ----------
        duration : float
            Simulated time to add [s], > 0.
        every, times, fps
            Frames, as for `simulate`. Default: the schedule of this run, counted from its start.
        force, callback, progress
            As for `simulate`. If this run has a `force`, it must be given again.

        Returns
        -------
        Run
            A run whose first frame is the last frame of this run; ``run + more`` is one run of
            both.

        Examples
        --------
        >>> scene = cs.scenes.paper_moving()
        >>> run = cs.simulate(scene, 0.02, dt=1e-4)
        >>> both = run + run.resume(0.03)
        >>> both.t.tolist(), both.report["steps"]
        ([0.0, 0.02, 0.05], 500)
        """
        from .simulate import resume_run

        return resume_run(self, duration, every, times, fps, force, callback, progress)

    def at(self, row: int, column: int) -> dict[str, Floats]:
        """Return the motion of a mass point over the stored frames.

        Parameters
        ----------
        row, column : int
            Place of the mass point, negative from the end.

        Returns
        -------
        dict
            "t" [s], shape (frames,); "x" [m] and "v" [m/s], shape (frames, 3); "speed" `|v|` [m/s]
            and "stretch", shape (frames,). The stretch is l/L - 1 of the most stretched spring at
            the point, 0 where all are slack.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> corner = run.at(-1, -1)
        >>> corner["x"].shape, bool((corner["speed"][1:] > 0).all())
        ((6, 3), True)
        """
        rows, columns = self.scene.cloth.shape
        row = check.integer("row", row, minimum=-rows, maximum=rows - 1) % rows
        column = check.integer("column", column, minimum=-columns, maximum=columns - 1) % columns
        x = self.x[:, row, column]
        v = self.v[:, row, column]
        point = row * columns + column
        table = self.scene.cloth.spring_table()
        springs = table[(table["i"] == point) | (table["j"] == point)]
        ends = np.where(springs["i"] == point, springs["j"], springs["i"])
        lengths = np.linalg.norm(self.x.reshape(len(self), -1, 3)[:, ends] - x[:, None], axis=-1)
        stretch = (lengths / springs["rest_length"] - 1).max(axis=1, initial=0.0)
        return {
            "t": self.t,
            "x": x,
            "v": v,
            "speed": np.linalg.norm(v, axis=-1),
            "stretch": stretch,
        }

    def energy(self) -> dict[str, Floats]:
        """Compute the energies of the frames.

        Returns
        -------
        dict
            "kinetic", "elastic", "gravity", "force", "contact" and "total" [J], arrays of shape
            (frames,); see `clothsim.energy`.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.oscillator(), 1.0, dt=1e-3, fps=10)
        >>> total = run.energy()["total"]
        >>> total.shape, bool(abs(total - total[0]).max() < 1e-9)
        ((11,), True)
        """
        # Ctrl-C acts between two frames.
        frames = [energy(self.scene, *state) for state in zip(self.x, self.v, self.t)]
        return {name: np.array([frame[name] for frame in frames]) for name in frames[0]}

    def penetration(self, sphere: int | None = None) -> dict[str, Floats]:
        """Measure how deep the cloth is in the spheres, at their places at the times of frames.

        Parameters
        ----------
        sphere : int, optional
            Index into ``scene.spheres``. Default: the deepest over all spheres.

        Returns
        -------
        dict
            "points" and "triangles": depths [m] below the true radius, >= 0, arrays of shape
            (frames,); 0 without spheres. See `clothsim.penetration`.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.paper_moving(), 0.1, dt=1e-3, fps=50)
        >>> run.penetration()["points"]
        array([0., 0., 0., 0., 0., 0.])
        """
        spheres = self.scene.spheres
        if sphere is not None:
            last = len(spheres) - 1
            if last < 0:
                raise ValueError(
                    f"sphere must be None for a scene without spheres, "
                    f"got {check.value_text(sphere)}"
                )
            spheres = (spheres[check.integer("sphere", sphere, minimum=0, maximum=last)],)
        return greatest_depths(spheres, self.x, self.t)

    def stretch(self) -> dict[str, Floats]:
        """Measure the stretch of the most stretched spring of each frame.

        Returns
        -------
        dict
            "largest": l / L - 1, an array of shape (frames,); see `clothsim.largest_stretch`.

        Examples
        --------
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

        Examples
        --------
        >>> import tempfile
        >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.save(folder + "/run").name
        'run.npz'
        """
        path = _files.npz_path(path)
        _check_arrays(self)
        texts = {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)}
        if self.snapshot is not None and self.continuation is not None:
            texts |= snapshot.snapshot_to_arrays(self.snapshot)
            texts["continuation"] = json.dumps(asdict(self.continuation))
        return _files.write_npz(path, {"t": self.t, "x": self.x, "v": self.v, **texts})

    def to_xarray(self) -> xarray.Dataset:
        """Return an `xarray.Dataset` with the dimensions time, row, column and component.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3, fps=50)
        >>> dict(run.to_xarray().sizes)
        {'time': 6, 'row': 1, 'column': 2, 'component': 3}
        """
        xr = import_from_extra("xarray", "to_xarray")
        dimensions = ("time", "row", "column", "component")
        dataset: xarray.Dataset = xr.Dataset(
            {
                "position": (dimensions, self.x, {"units": "m"}),
                "velocity": (dimensions, self.v, {"units": "m/s"}),
            },
            # zarr has no specification for NumPy's texts of one length, and warns of them.
            {
                "time": ("time", self.t, {"units": "s"}),
                "component": np.array(["x", "y", "z"], object),
            },
            {"scene": json.dumps(self.scene.to_dict()), "report": json.dumps(self.report)},
        )
        return dataset

    # The room `viewing` makes pictures and files for other programs.

    def picture(
        self,
        frame: int | None = None,
        t: float | None = None,
        path: str | Path | None = None,
        **style: Any,
    ) -> Any:
        """Draw a stored frame; see `clothsim.picture`.

        All frames of a run are drawn from one view, so that two pictures can be compared.

        Parameters
        ----------
        frame : int, optional
            Index of the stored frame, negative from the end. Default: the last.
        t : float, optional
            Time [s], in place of `frame`. The nearest stored frame is drawn.
        path : path-like, optional
            File to write as well; see `Picture.save`.
        **style
            camera, width, color, limits, label and ground, as for `clothsim.picture`. The view, the
            colour scale and the ground are those of all frames. An array as `color` has shape
            (rows, columns) or (frames, rows, columns).

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.02, dt=1e-3, every=10)
        >>> run.picture(t=0.01, width=200)
        <Picture of 200 x 129 pixels>
        """
        return find_service("picture_of_run")(self, frame, t, path, **style)

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw energy, largest stretch, penetration and contacts over the stored frames.

        A contact is a mass point closer to a sphere than the contact radius plus 1/32 of the grid
        spacing.

        Parameters
        ----------
        path : path-like, optional
            File to write as well, of a format that matplotlib knows.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, fps=50)
        >>> [axes.get_ylabel() for axes in run.plot().axes]
        ['energy [J]', 'largest stretch [%]', 'penetration [mm]', 'points in contact']
        """
        return find_service("draw_run")(self, path)

    def animate(
        self,
        path: str | Path,
        fps: float = 30.0,
        *,
        speed: float = 1.0,
        progress: bool = False,
        **style: Any,
    ) -> Path:
        """Write a film of the run.

        Each picture shows the stored frame that is nearest in time: a smooth film needs
        ``every=speed / fps``.

        Parameters
        ----------
        path : path-like
            Ends in ".gif", ".webp" (both by Pillow, extra "plot") or ".mp4" (H.264, by the program
            ffmpeg or the extra "film").
        fps : float, default 30
            Pictures a second, > 0, at most 240; at most 50 for a GIF, because browsers slow down
            faster ones.
        speed : float, default 1.0
            Simulated seconds in a second of the film, > 0.
        progress : bool, default False
            True shows a progress bar of simulated seconds.
        **style
            As for `picture`. The view, the colour scale and the ground are the same for all frames.

        Examples
        --------
        >>> import tempfile
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.animate(folder + "/swing.gif", fps=25, width=64).name
        'swing.gif'
        """
        film: Path = find_service("animate")(self, path, fps, speed, progress, **style)
        return film

    @check.check_names
    def to_html(self, path: str | Path, *, title: str | None = None) -> Path:
        """Write one self-contained page that plays the run in a browser; `clothsim.compare` plays
        several side by side.

        The page makes no request. Positions are rounded to 1/65535 of the run's extent on each
        axis. 300 frames of 32 x 32 take 1.1 MB.

        Parameters
        ----------
        path : path-like
            File to write.
        title : str, optional
            Heading of the page. Default: the name of a ready scene, or the shape of the cloth and
            the responses of its spheres.

        Examples
        --------
        >>> import tempfile
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, every=5)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = run.to_html(folder + "/run.html")
        ...     path.name, path.stat().st_size < 500_000
        ('run.html', True)
        """
        page: Path = find_service("comparison_of")(self, title).to_html(path)
        return page

    @check.check_names
    def show(self, *, height: int = 760) -> Any:
        """Play the run in a notebook: the page of `to_html` in a frame of the cell.

        Parameters
        ----------
        height : int, default 760
            Height of the frame [pixels], 300 to 4000.

        Examples
        --------
        >>> run = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3, fps=50)
        >>> frame = run.show(height=500)  # the last line of a notebook's cell
        """
        return find_service("comparison_of")(self).show(height)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """Return the lines of `print` and a picture of the last frame, for a notebook."""
        bundle: dict[str, Any] = find_service("run_bundle")(self)
        return bundle

    @check.check_names
    def export(
        self, path: str | os.PathLike[str], fps: float | None = None, z_up: bool = False
    ) -> list[Path]:
        """Write the run as files for other programs, in the format that the suffix names.

        ===================  ====================================================================
        Suffix               Files
        ===================  ====================================================================
        .usdc, .usda         OpenUSD: a mesh with time samples, sphere prims; needs usd-core
        .glb                 Binary glTF: every frame is a morph target, spheres are meshes
        .obj                 A sequence name_0001.obj, ...; the spheres are further objects
        .ply                 A sequence name_0001.ply, ...; name_sphere_0_0001.ply, ... for spheres
        .pvd                 VTK: an index name.pvd, and name_0001.vtp, ... for cloth and spheres
        .pc2                 A point cache, and the mesh of the first frame as .obj beside it
        ===================  ====================================================================

        Vertices of the cloth are the mass points in the order of the array index. Texture
        coordinates run from 0 to 1: u along the columns, v from the last row to the first.
        docs/export.md shows how to open the files.

        Parameters
        ----------
        path : path-like
            File to write, in a folder that exists. A failed export changes nothing.
        fps : float, optional
            Frames a second [1/s], > 0, at most 1e5. The first frame is the start of the run. Cubic
            Hermite interpolation of positions and velocities gives frames between stored frames.
            Default: the stored frames at their own times.
        z_up : bool, default False
            Whether (x, y, z) is written as (x, -z, y), for programs where z is up. A .glb is
            always y up.

        Returns
        -------
        list of pathlib.Path
            The files written. The first is the file to open.

        Warns
        -----
        UserWarning
            If interpolation may be wrong by more than a tenth of the grid spacing. More than a
            spacing is an error.

        Examples
        --------
        >>> import tempfile
        >>> run = cs.simulate(cs.scenes.paper_static(), 0.1, dt=1e-3, fps=60)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [file.name for file in run.export(folder + "/cloth.pc2")]
        ['cloth.pc2', 'cloth.obj']
        """
        files: list[Path] = find_service("export")(self, path, fps, z_up)
        return files


@check.check_names
def load_run(path: str | os.PathLike[str]) -> Run:
    """Read a run that `Run.save` wrote. Nothing in the file is executed.

    Parameters
    ----------
    path : path-like

    Examples
    --------
    >>> import tempfile
    >>> run = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = cs.load_run(run.save(folder + "/run"))
    >>> again == run
    True
    """
    data = _files.read_npz(path, "run", ("t", "x", "v", "scene", "report"))
    with _files.explain_unreadable_file(path, "run"):
        scene = Scene.from_dict(json.loads(str(data["scene"])))
        report = json.loads(str(data["report"]))
        final_state = continuation = None
        if "continuation" in data:
            settings = json.loads(str(data["continuation"]))
            frames = Frames(**{**settings["frames"], "times": tuple(settings["frames"]["times"])})
            continuation = Continuation(**{**settings, "frames": frames})
            final_state = snapshot.snapshot_from_arrays(data)
        run = Run(
            scene=scene,
            t=data["t"],
            x=data["x"],
            v=data["v"],
            report=report,
            snapshot=final_state,
            continuation=continuation,
        )
        _check_arrays(run)
        return run


def greatest_depths(spheres: Iterable[Sphere | Plane], x: Floats, t: Floats) -> dict[str, Floats]:
    """Return the greatest depths of points and of triangles in any sphere, shape (frames,) [m]."""
    depths = {name: np.zeros(len(t)) for name in ("points", "triangles")}
    for sphere in spheres:
        for name, depth in penetration(x, sphere, t).items():
            np.maximum(depths[name], depth, out=depths[name])
    return depths


def _check_arrays(run: Run) -> None:
    """Raise a ValueError where times or frames do not fit the scene or each other."""
    shape = (len(run.t), *run.scene.cloth.shape, 3) if run.t.ndim == 1 else ()
    for name, array, expected in (
        ("t", run.t, shape[:1]),
        ("x", run.x, shape),
        ("v", run.v, shape),
    ):
        if array.dtype != np.float64 or array.shape != expected or not array.size:
            raise ValueError(
                f"{name} must be float64 of shape {expected or '(frames,)'}, got "
                f"{array.dtype} of shape {array.shape}"
            )
        check.check_all(name, array, np.isfinite(array), "finite numbers")
    check.check_all("t", run.t, np.diff(run.t, prepend=-np.inf) > 0, "increasing times")


def _summary_lines(run: Run) -> list[str]:
    """Return the lines of `print`; frames of a user's own have the first two."""
    scene = run.scene
    t = run.t
    report = run.report
    stopped = f", stopped early ({report['stopped']})" if report.get("stopped") else ""
    lines = [
        f"Run of {cloth_text(scene)}, {spheres_text(scene)}",
        f"{format_count(len(t), 'frame')} from t = {t[0]:.6g} to {t[-1]:.6g} s{stopped}",
    ]
    if "energy" not in report:
        return lines
    about = "about " if run.continuation is not None and run.continuation.dt is None else ""
    return [
        *lines,
        f"{format_count(report['steps'], 'step')} of {about}{format_quantity(report['dt'], 's')} "
        f"by {report['integrator']} in {report['precision']}",
        _energy_line(scene, report),
        _penetration_line(scene, report["penetration"]),
        f"{report['wall_time']:.3g} s of computing on {format_count(report['threads'], 'thread')}, "
        f"{report['steps_per_second']:,.0f} steps/s",
        _error_line(report),
    ]


def _energy_line(scene: Scene, report: Mapping[str, Any]) -> str:
    """Return the change of energy by cause: works that are known, and the rest with its causes."""
    start = report["energy"]["start"]["total"]
    end = report["energy"]["end"]["total"]
    works = {
        "force": report["force_work"],
        "wind": report["wind_work"],
        "moving obstacles": sum(report["obstacle_work"]),
    }
    works = {cause: work for cause, work in works.items() if math.isfinite(work) and work != 0}
    rest = end - start - sum(works.values())
    texts = format_joules([start, end, rest, *works.values()])
    text = f"energy {texts[0]} at the start, {texts[1]} at the end"
    if report["reason"] != Reason.NO_REST_ASKED:
        return text  # The run is of `settle`, which follows no motion.
    has_contact = report["first_contact"]["reason"] != Reason.UNTOUCHED
    has_losses = any(
        obstacle.damped or obstacle.response != "penalty" for obstacle in scene.spheres
    )
    lacks_work = any(map(math.isnan, report["obstacle_work"]))
    causes = {
        "damping": scene.cloth.damped,
        "contact": has_contact and has_losses,
        "moving obstacles": lacks_work and any(obstacle.motion for obstacle in scene.spheres),
        "driven pins": bool(scene.cloth.driven),
    }
    changes = [f"{change} by {cause}" for change, cause in zip(texts[3:], works)]
    other_causes = ", ".join(cause for cause, acts in causes.items() if acts)
    causes_of_rest = f"{other_causes} and the method" if other_causes else "the method"
    changes.append(f"{texts[2]} by {causes_of_rest}")
    return f"{text}: {', '.join(changes)}"


def _error_line(report: Mapping[str, Any]) -> str:
    """Return the error at the end and the one that was asked for, or why it is not known."""
    error = report["error_estimate"]
    request = report["tolerance"]["asked"]
    if math.isnan(error["rms"]):
        return f"error not known: {error['reason']}"
    text = f"error at the end about {error['rms']:.2g} m"
    if math.isnan(request):
        return text
    if report["tolerance"]["reached"]:
        return f"{text} (asked {request:.2g})"
    return f"{text} (asked {request:.2g}, not reached: {error['reason']})"


def _penetration_line(scene: Scene, depths: Any) -> str:
    if not scene.spheres:
        return "penetration: no sphere"
    parts = [
        f"{name} {format_quantity(depths[name], 'm')}"
        for name in ("points", "triangles")
        if not math.isnan(depths[name])
    ]
    if not parts:
        return f"deepest penetration not known: {depths['reason']}"
    return f"deepest penetration: {', '.join(parts)}"
