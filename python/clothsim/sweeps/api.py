"""`sweep`: many cloths from one call, from checked arguments to a labelled Dataset."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from ..base import check
from ..base.build import build_config, provenance
from ..base.extras import needed
from ..base.interrupts import Interrupts
from ..base.progress import ProgressBar
from ..errors import warn_caller
from ..model.fields import RUN
from ..model.scene import Scene
from ..typing import Every, Integrator, Kernel, Precision
from .grid import Grid, make_grid, plain
from .member import FAILED, PENDING, Member, SweepOptions
from .metrics import DEFAULT_METRICS, choose_metrics, describe
from .store import SCHEMA, Results, Store, open_sweep
from .workers import TaskResult, Workers, checked_members, tasks

if TYPE_CHECKING:
    import xarray


def sweep(
    scene: Scene,
    over: Mapping[Any, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    duration: float = 1.0,
    metrics: str | Callable[..., Any] | Sequence[Any] | Mapping[str, Any] = DEFAULT_METRICS,
    dt: float | None = None,
    integrator: Integrator | None = None,
    precision: Precision = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: Every | None = None,
    frames: bool = False,
    store: str | os.PathLike[str] | None = None,
    resume: bool = True,
    executor: Any = None,
    threads: int | None = None,
    progress: bool = True,
    kernel: Kernel = "auto",
    **unknown: NoReturn,
) -> xarray.Dataset:
    """Run a scene once for every combination of values, and label the results.

    A member's result has the same bits as `simulate` gives for it alone. docs/sweeps.md describes names and metrics.

    Parameters
    ----------
    scene : Scene
        Values that are not swept.
    over : mapping, or sequence of mappings
        ``{name: values}`` is a grid: one dimension per name, every combination a member; `sweepable` lists the names.
        ``{(name, name): [(value, value), ...]}`` are zipped lists, one dimension for both.
        ``{name: {label: value}}`` labels values that are not numbers. A sequence of mappings (or a
        table with ``to_dict("records")``) are given samples, with the dimension "sample".
    duration : float, default 1.0
        Simulated time [s], > 0.
    metrics : sequence, mapping, name or function
        Names: "error" (and error_rms, reference_error), "energy_drift", "energy_gained", "largest_stretch",
        "penetration" (and penetration_points), "stable", "steps_per_second", "sag", "first_contact",
        "impulse" (and impulse_x, impulse_y, impulse_z). A function takes a `Run`, with the frames of `every`, and
        returns a number, an array, or a mapping of them. It must pickle to run in another process.
    dt, rtol, atol, integrator, precision, kernel
        As for `simulate`, where they are not swept. Default: "rk4" with half of each member's `max_stable_dt`. Where
        a tolerance is swept beside dt, None marks a setting that a member does not use.
    every : int, float or "step", optional
        Frames, as for `simulate`; seconds if they are stored and dt is swept.
    frames : bool, default False
        True stores the frames too: position and velocity, shape (..., time, row, column, 3).
        Smaller cloths are filled up with NaN.
    store : path-like, optional
        Folder of a zarr store, written as results come. Repeat an interrupted call: it computes the missing members.
    resume : bool, default True
        False refuses a store that exists.
    executor : concurrent.futures.Executor or dask.distributed.Client, optional
        Executor that runs the members. Default: threads of this process.
    threads : int, optional
        Threads of this process; default: one per processor. With an executor: threads of each task; default: 1.
    progress : bool, default True
        Show a bar with members done, their rate and the time left, in a terminal or notebook.

    Returns
    -------
    xarray.Dataset
        One dimension per swept name, with coordinates that have units. Beside the metrics: "status" (0 pending, 1 done,
        2 unstable, 3 failed), "max_stable_dt" [s], "unstable_step", "unstable_time" [s] and "message". Of a member that
        diverged or failed, metrics are NaN ("stable" False). After a contact "error" is NaN too, and the message says
        why. ``ds.clothsim`` plots, and has the provenance. Frames in a `store` are read when they are used.

    Raises
    ------
    ValueError, TypeError
        Before anything has been run or written: an argument is not as above, a member cannot be made, or the store is
        of another sweep (with the differences) or damaged.
    KeyboardInterrupt
        On Ctrl-C; the store then has all finished members.

    Warns
    -----
    RuntimeWarning
        If a metric fails for a member.

    Examples
    --------
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> result = cs.sweep(scene, {"stiffness": [1e3, 1e5], "dt": [1e-3, 1e-1]}, duration=0.2, progress=False)
    >>> result.stable.values.tolist()
    [[True, False], [True, False]]
    >>> result.stiffness.attrs["units"], result.sizes["dt"]
    ('N/m', 2)
    """
    needed("xarray", "sweep")  # so that an ImportError comes before the runs
    if store is not None:
        needed("zarr", "store=...")
    check.no_argument(unknown)
    if check.boolean("progress", progress):
        needed("tqdm", "progress=True")
    check.instance("scene", scene, Scene)
    grid = make_grid(over)
    chosen = choose_metrics(metrics)
    options = SweepOptions(duration, dt, integrator, precision, kernel, every, frames, chosen, rtol, atol)
    _check_grid(grid, options)
    made = checked_members(scene, grid, options)
    workers = Workers(executor, threads)
    try:
        identity = _identity(scene, grid, options)
        session = {**provenance(), "wall_time": 0.0, "hosts": [], "instruction_sets": []}
        results = Results(grid, options, scene)
        if store is not None:
            resume = check.boolean("resume", resume)
            results = Store(check.path("store", store), resume, identity, session, grid, options, scene)
        _run(workers, made, results, session, progress)
    finally:
        workers.close()
    failed = results.variables["status"].values == FAILED
    if failed.any():
        first = results.variables["message"].values[failed][0]
        warn_caller(f"{int(failed.sum())} of {failed.size} members failed; the first: {first}", RuntimeWarning)
    if store is not None and frames:
        return open_sweep(store)
    sessions = results.sessions if isinstance(results, Store) else [session]
    return results.dataset({"schema": SCHEMA, "identity": identity, "sessions": sessions})


def _check_grid(grid: Grid, options: SweepOptions) -> None:
    """Refuse arguments that swept values would replace, and frames that have no common times."""
    if options.frames and "duration" in grid.names:
        raise ValueError("frames must be False where duration is swept: the times would differ")
    if options.frames and isinstance(options.every, int) and ("dt" in grid.names or options.dt is None):
        raise ValueError(f"every must be in seconds (a float) to store frames of different dt, got {options.every} steps")
    default = SweepOptions()
    for name in grid.names:
        if name in RUN and (given := getattr(options, name)) != getattr(default, name):
            raise ValueError(f"{name} must be left out where over has it, got {name} = {given!r} beside its swept values")


def _identity(scene: Scene, grid: Grid, options: SweepOptions) -> dict[str, Any]:
    """Identity of a sweep, as JSON can hold it."""
    settings = {**vars(options), "metrics": [describe(metric) for metric in options.metrics]}
    return {
        "version": build_config()["version"],
        "scene": scene.to_dict(),
        "over": grid.describe(),
        "settings": {name: plain(value) for name, value in settings.items()},
    }


def _run(workers: Workers, made: dict[int, Member], results: Results, session: dict[str, Any], progress: bool) -> None:
    start, pending = time.perf_counter(), results.pending
    members, unstable = results.grid.size, 0
    bar = ProgressBar(progress, total=members, initial=members - len(pending), unit="member", desc="sweep")

    def record(result: TaskResult) -> None:
        nonlocal unstable
        results.record(result.records)
        unstable += sum([one.unstable_step >= 0 for one in result.records])
        session["wall_time"] = time.perf_counter() - start
        for name in ("host", "instruction_set"):
            known = session[f"{name}s"]
            if getattr(result, name) not in known:
                known.append(getattr(result, name))
        results.flush()
        if unstable:
            bar.say(f"sweep, {unstable} unstable")
        bar.advance(len(result.records))

    error: BaseException | None = None
    try:
        workers.run_all(tasks(results.scene, results.grid, results.options, pending, workers, made), record)
    except BaseException as caught:
        error = caught
    with Interrupts():  # a second Ctrl-C waits
        session["wall_time"] = time.perf_counter() - start
        bar.close()
        try:
            results.flush(final=True)
        finally:
            results.close()
        if isinstance(error, KeyboardInterrupt):
            status = results.variables["status"].values
            kept = "were done; give a store to keep them"
            if isinstance(results, Store):
                kept = f"are in {results.path}; repeat the sweep to compute the rest"
            raise KeyboardInterrupt(f"{int((status != PENDING).sum())} of {status.size} members {kept}") from None
        if error is not None:
            raise error
