"""`sweep`: many cloths from one call."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import _validate as check
from .._extras import needed
from ..build import build_config
from ..scene import Scene
from .dataset import open_sweep, to_dataset
from .engine import Workers, run_all
from .grid import Grid, make_grid
from .member import Members, Settings
from .metrics import choose_metrics, describe
from .plain import plain
from .planning import SHORTEST, Planner
from .progress import Bar
from .results import Results
from .store import SCHEMA, Store
from .task import TaskResult

_CHECKED = 2048  # members that are made before anything is run, to find what cannot be

DEFAULT_METRICS = ("stable", "energy_drift", "largest_stretch")


def sweep(
    scene: Scene,
    over: Mapping[Any, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    duration: float = 1.0,
    metrics: str | Callable[..., Any] | Sequence[Any] | Mapping[str, Any] = DEFAULT_METRICS,
    dt: float | None = None,
    integrator: str | None = None,
    precision: str = "double",
    rtol: float | None = None,
    atol: float | None = None,
    every: int | float | None = None,
    frames: bool = False,
    store: str | os.PathLike[str] | None = None,
    resume: bool = True,
    executor: Any = None,
    threads: int | None = None,
    progress: bool = True,
    kernel: str = "auto",
    strict: bool = False,
    sampling: int = 32,
    task_seconds: float | None = None,
) -> Any:
    """Run a scene once for every combination of values, and label what comes out.

    A member's result has the same bits as `simulate` gives for it alone. One that diverges is
    marked and harms no other.

    Parameters
    ----------
    scene : Scene
        What is not swept.
    over : mapping, or sequence of mappings
        ``{name: values}`` is a grid: one dimension per name, every combination a member.
        ``{(name, name): [(value, value), ...]}`` are zipped lists, one dimension for both.
        ``{name: {label: value}}`` labels values that are no numbers. A sequence of mappings (or a
        table with ``to_dict("records")``) are given samples, with the dimension "sample".

        Names are the arguments of `Cloth` and `Scene`; those of `Sphere` with "sphere_" in front
        (of every sphere) or "sphere1_" (of the one with index 1); parts of them such as
        "stiffness_shear", "damping_bend", "gravity_y", "sphere_center_x"; "sphere_speed" [m/s] and
        the other arguments of a sphere's motion; "scene"; and "dt", "rtol", "atol", "duration",
        "integrator", "precision", "kernel" and "strict". ``clothsim.sweep.fields.NAMES`` has them
        all.
    duration : float, default 1.0
        Simulated time [s], > 0.
    metrics : sequence, mapping, name or function
        Names: "error" (gives error, error_rms and reference_error [m], see docs/sweeps.md),
        "energy_drift" [J], "largest_stretch", "penetration" (and penetration_points) [m],
        "stable", "steps_per_second" [1/s], "first_contact" [s]. A function is given a `Run` (with
        the frames of `every`) and returns a number, an array, or a mapping of them; to leave this
        process it has to pickle. Default: "stable", "energy_drift" and "largest_stretch".
    dt : float, optional
        Time step [s], where it is not swept. Default: half of `max_stable_dt`, of each member.
    integrator, precision, kernel, strict
        As for `step`, where they are not swept. The default of `integrator` is "rk4"; "auto", the
        default with `rtol` or `atol`, chooses as `simulate` does.
    rtol, atol : float, optional
        Error control in place of `dt`, as for `simulate`, where it is not swept. Where one is
        swept beside dt (zipped, or as samples), None stands for what a member does without.
    every : int or float, optional
        Frames, as for `simulate`; seconds if they are stored and dt is swept.
    frames : bool, default False
        True stores the frames too: position and velocity, shape (..., time, row, column, 3).
        Smaller cloths are filled up with NaN.
    store : path-like, optional
        Folder of a zarr store. Results are written to it as they come; the same call again, after
        whatever end of the first, does what is missing.
    resume : bool, default True
        False refuses a store that exists.
    executor : concurrent.futures.Executor or dask.distributed.Client, optional
        Where the members are run. Default: threads of this process.
    threads : int, optional
        Of this process. Default: one per processor. With an executor: of each task; default 1.
    progress : bool, default True
        Show a bar with members done, their rate and the time left.
    sampling : int, default 32
        "largest_stretch" and "penetration" are taken over at least so many states, evenly spaced
        over the steps, the first and the last among them.
    task_seconds : float, optional
        Length of a task [s], >= 0.3, where there is work enough. Default: 1.0. Longer ones spare
        the scheduler of a large cluster; what a task has done is lost if its worker dies.

    Returns
    -------
    xarray.Dataset
        Dimensions are what is swept, with coordinates that carry their units. Beside the metrics:
        "status" (0 pending, 1 done, 2 unstable, 3 failed), "max_stable_dt" [s], "unstable_step",
        "unstable_time" [s] and "message". Of a member that diverged or failed, metrics are NaN
        ("stable" False). ``ds.clothsim.provenance`` tells where the results come from. Frames
        in a `store` are read from it as they are used.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, a member cannot be made, or the store is of another sweep
        (the message tells what differs); nothing has been run or written then.
    ImportError
        Without xarray, zarr (for `store`) or tqdm (for `progress`): the extra "sweep".
    KeyboardInterrupt
        On Ctrl-C; the store then holds what has been finished.

    Examples
    --------
    >>> import clothsim as cs
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> result = cs.sweep(scene, {"stiffness": [1e3, 1e5], "dt": [1e-3, 1e-1]}, duration=0.2,
    ...                   progress=False)
    >>> result.stable.values.tolist()
    [[True, False], [True, False]]
    >>> result.stiffness.attrs["units"], result.sizes["dt"]
    ('N/m', 2)
    """
    needed("xarray", "sweep")
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, got {scene!r} ({type(scene).__name__})")
    grid = make_grid(over)
    settings = Settings(
        duration=check.number("duration", duration, minimum=0, exclusive=True),
        dt=None if dt is None else check.number("dt", dt, minimum=0, exclusive=True),
        integrator=integrator,
        precision=precision,
        rtol=rtol,
        atol=atol,
        kernel=kernel,
        strict=check.boolean("strict", strict),
        every=_every(every),
        frames=check.boolean("frames", frames),
        sampling=check.integer("sampling", sampling, minimum=1),
        metrics=choose_metrics(metrics),
    )
    progress = check.boolean("progress", progress)
    _check_frames(grid, settings)
    members = _checked_members(scene, grid, settings)
    if task_seconds is not None:
        task_seconds = check.number("task_seconds", task_seconds, minimum=SHORTEST)
    workers = Workers(executor, threads)
    try:
        identity = _identity(scene, grid, settings)
        session = _provenance()
        results: Results
        if store is None:
            results = Results(grid, settings, scene)
        else:
            where = Path(store)
            results = Store(where, grid, settings, scene, identity, session, resume)
        _run(workers, members, results, session, progress, task_seconds)
    finally:
        workers.close()
    _warn_of_failures(results)
    if store is not None and settings.frames:
        return open_sweep(store)
    sessions = results.attrs["sessions"] if isinstance(results, Store) else [session]
    return to_dataset(results, {"schema": SCHEMA, "identity": identity, "sessions": sessions})


def _run(
    workers: Workers,
    members: Members,
    results: Results,
    session: dict[str, Any],
    progress: bool,
    task_seconds: float | None,
) -> None:
    start = time.perf_counter()
    pending = results.pending
    grid = results.grid
    planner = Planner(members, pending, workers.count, task_seconds, workers.shortest_task)
    planner.threads = workers.threads_of(planner.expected_tasks)
    weights = planner.weights
    bar = Bar(progress, grid.size, grid.size - len(pending), float(weights[pending].sum()))

    def record(result: TaskResult) -> None:
        for one in result.records:
            results.record(one)
        session["wall_time"] = time.perf_counter() - start
        session["tasks"] += 1
        session["task_seconds"] += result.seconds
        for name in ("host", "instruction_set"):
            known = session[f"{name}s"]
            if getattr(result, name) not in known:
                known.append(getattr(result, name))
        results.flush()
        unstable = sum(one.unstable_step >= 0 for one in result.records)
        cost = float(weights[[one.index for one in result.records]].sum())
        bar.advance(len(result.records), unstable, cost)

    try:
        run_all(workers, planner, record, results.prepare)
    finally:
        session["wall_time"] = time.perf_counter() - start
        bar.close()
        try:
            results.flush(final=True)
        finally:
            results.close()


def _every(every: Any) -> int | float | None:
    if every is None:
        return None
    if isinstance(every, float):
        return check.number("every", every, minimum=0, exclusive=True)
    return check.integer("every", every, minimum=1)


def _check_frames(grid: Grid, settings: Settings) -> None:
    """Stored frames have one time axis for all members."""
    if not settings.frames:
        return
    if "duration" in grid.names:
        raise ValueError("frames must be False where duration is swept: the times would differ")
    if isinstance(settings.every, int) and ("dt" in grid.names or settings.dt is None):
        raise ValueError(
            f"every must be in seconds (a float) to store frames of different dt, "
            f"got {settings.every} steps"
        )


def _checked_members(scene: Scene, grid: Grid, settings: Settings) -> Members:
    """The members; all or those that between them have every value are made, to find what is
    refused."""
    members = Members(scene, grid, settings)
    if grid.size <= _CHECKED:
        indices = range(grid.size)
    else:
        first = {k: 0 for k in range(len(grid.axes))}
        places = [{**first, k: p} for k, axis in enumerate(grid.axes) for p in range(len(axis))]
        strides = [1] * len(grid.axes)
        for k in reversed(range(len(grid.axes) - 1)):
            strides[k] = strides[k + 1] * grid.shape[k + 1]
        indices = [sum(p * strides[k] for k, p in place.items()) for place in places[:_CHECKED]]
    for index in indices:
        try:
            members.make(index)
        except (ValueError, TypeError) as error:
            values = grid.member(index)
            if not values:
                raise
            which = ", ".join(f"{name}={value!r}" for name, value in values.items())
            raise type(error)(f"over has the member {which} that cannot be run: {error}") from error
    return members


def _identity(scene: Scene, grid: Grid, settings: Settings) -> dict[str, Any]:
    """What tells this sweep from another, as JSON can hold it."""
    return {
        "version": build_config()["version"],
        "scene": scene.to_dict(),
        "over": grid.describe(),
        "settings": {
            name: [describe(metric) for metric in settings.metrics]
            if name == "metrics"
            else plain(value)
            for name, value in vars(settings).items()
        },
    }


def _provenance() -> dict[str, Any]:
    from ..reproduce.report import provenance

    return {
        **provenance(), "wall_time": 0.0, "tasks": 0, "task_seconds": 0.0, "hosts": [],
        "instruction_sets": [],
    }  # fmt: skip


def _warn_of_failures(results: Results) -> None:
    if failed := results.count("failed"):
        messages = results.variables["message"].values.ravel()
        status = results.variables["status"].values.ravel()
        first = int((status == 3).argmax())
        warnings.warn(
            f"{failed} of {results.grid.size} members failed; the first: {messages[first]}",
            RuntimeWarning,
            stacklevel=3,
        )
