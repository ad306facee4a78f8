"""`sweep`: many cloths from one call.

Arguments are checked, tasks run on threads or an executor, and results become a labelled Dataset.
"""

from __future__ import annotations

import dataclasses
import math
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..base import check
from ..base.build import available_thread_count, build_config, provenance
from ..base.extras import import_from_extra
from ..base.interrupts import Interrupts
from ..base.progress import ProgressBar
from ..engine.options import Options
from ..errors import ContactError, UnstableError, warn_caller
from ..methods.bound import stable_dt
from ..methods.integrators import warn_of_order
from ..model.fields import NUMERICS, RUN
from ..model.scene import Scene
from ..run.frames import Frames
from ..run.recording import PAUSE, Failure
from ..run.result import Run
from ..run.simulate import run_batch, simulate
from ..run.trajectory import Job
from ..typing import Force, Integrator, Kernel, Precision
from .grid import Grid, make_grid, plain_data
from .member import DONE, FAILED, PENDING, UNSTABLE, Member, MemberMaker, MemberRecord, SweepOptions
from .metrics import (
    DEFAULT_METRICS,
    METRICS,
    Metrics,
    choose_metrics,
    compute_reference,
    compute_variables,
    metric_identity,
    reason_without_error,
)
from .store import SCHEMA, Results, Store

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

    import xarray

LARGEST_BATCH = 64
"""Most members of a call. More save nothing, and all of their states are in memory at once."""

_MOST_TASKS = 256  # most tasks that an executor has, each with the scenes of its members
# Each worker gets so many tasks if there are enough members, so that all workers end together.
_LEAST_TASKS = 4
_WORKERS = 32  # number of workers of an executor that does not tell it
_MOST_CHECKED = 2048  # members that are made before anything is run, to find errors


@check.check_names
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
    every: float | None = None,
    store: str | os.PathLike[str] | None = None,
    executor: Any = None,
    threads: int | None = None,
    progress: bool = True,
    kernel: Kernel = "auto",
    force: Force | None = None,
) -> xarray.Dataset:
    """Run a scene once for every combination of values, and label the results.

    A member's result has the same bits as `simulate` gives for it alone. docs/sweeps.md describes
    names and metrics.

    Parameters
    ----------
    scene : Scene
        Values that are not swept.
    over : mapping, or sequence of mappings
        ``{name: values}`` is a grid: one dimension per name, every combination a member;
        `sweepable` lists the names. ``{(name, name): [(value, value), ...]}`` are zipped lists, one
        dimension for both. ``{name: {label: value}}`` labels values that are not numbers. A
        sequence of mappings (or a table with ``to_dict("records")``) are given samples, with the
        dimension "sample".
    duration : float, default 1.0
        Simulated time [s], > 0.
    metrics : sequence, mapping, name or function
        Names: "error" (and error_rms, reference_error), "energy_drift", "energy_gained",
        "largest_stretch", "penetration" (and penetration_points), "stable", "steps_per_second",
        "sag", "first_contact", "impulse" (and impulse_x, impulse_y, impulse_z). A function takes a
        `Run`, with the frames of `every`, and returns a number, an array, or a mapping of them. It
        must pickle to run in another process.
    dt, rtol, atol, integrator, precision, kernel
        As for `simulate`, where they are not swept; without dt, rtol and atol each member meets
        rtol 1e-3. Where a tolerance is swept beside dt, None marks a setting that a member
        does not use.
    every : int or float, optional
        Frames, as for `simulate`.
    store : path-like, optional
        Folder of a zarr store, written as results come. Repeat an interrupted call: it computes the
        missing members.
    executor : concurrent.futures.Executor or dask.distributed.Client, optional
        Executor that runs the members. Default: threads of this process.
    threads : int, optional
        Threads of this process; default: one per processor. With an executor: threads of each task;
        default: 1.
    progress : bool, default True
        Show a bar with members done, their rate and the time left, in a terminal or notebook.
    force : callable, optional
        As for `simulate`, of every member. It must pickle to run in another process.

    Returns
    -------
    xarray.Dataset
        One dimension per swept name, with coordinates that have units. Beside the metrics: "status"
        (0 pending, 1 done, 2 unstable, 3 failed), "max_stable_dt" [s], "unstable_step",
        "unstable_time" [s] and "message". Of a member that diverged or failed, metrics are NaN
        ("stable" False). After a contact "error" is NaN too, and the message says why.
        ``ds.clothsim`` plots, and has the provenance.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above, a member cannot be made, or the store is of another sweep
        (with the differences) or damaged.
    KeyboardInterrupt
        On Ctrl-C; the store then has all finished members.

    Warns
    -----
    RuntimeWarning
        If a metric fails for a member.

    Examples
    --------
    >>> scene = cs.scenes.hanging(shape=(4, 4))
    >>> over = {"stiffness": [1e3, 1e5], "dt": [1e-3, 1e-1]}
    >>> result = cs.sweep(scene, over, duration=0.2, progress=False)
    >>> result.stable.values.tolist()
    [[True, False], [True, False]]
    >>> result.stiffness.attrs["units"], result.sizes["dt"]
    ('N/m', 2)
    """
    import_from_extra("xarray", "sweep")  # An ImportError comes before the runs.
    if check.boolean("progress", progress):
        import_from_extra("tqdm", "progress=True")
    check.instance("scene", scene, Scene)
    grid = make_grid(over)
    choice = choose_metrics(metrics)
    options = SweepOptions(duration, dt, integrator, precision, kernel, every, rtol, atol, force)
    _check_grid(grid, options)
    make = MemberMaker(scene, options)
    members = make_probe_members(make, grid)
    workers = Workers(executor, threads)
    settings = dict(vars(options))
    settings["metrics"] = [metric_identity(name, metric) for name, metric in choice.items()]
    if force is not None:
        settings["force"] = metric_identity("force", force)
    identity = {
        "version": build_config()["version"],
        "scene": scene.to_dict(),
        "over": grid.plain_axes(),
        "settings": plain_data(settings),
    }
    description = {"schema": SCHEMA, "identity": identity, **provenance()}
    archive = None
    try:
        if store is not None:
            archive = Store(check.path("store", store), description)
        results = Results(grid, choice, description, archive)
        work = deal_tasks(make, grid, choice, options, results.members_to_run, workers, members)
        _run_tasks(workers, work, results, progress)
    finally:
        workers.close()
        if archive is not None:
            archive.release_lock()
    has_failed = results["status"] == FAILED
    if has_failed.any():
        first = results["message"][has_failed][0]
        warn_caller(
            f"{int(has_failed.sum())} of {has_failed.size} members failed; the first: {first}",
            RuntimeWarning,
        )
    return results.make_dataset()


def _check_grid(grid: Grid, options: SweepOptions) -> None:
    """Refuse arguments that swept values would replace."""
    default = SweepOptions()
    for name in grid.names:
        if name in RUN and getattr(options, name) != getattr(default, name):
            raise ValueError(
                f"{name} must be left out where over has it, got {name} = "
                f"{getattr(options, name)!r} beside its swept values"
            )


def _run_tasks(workers: Workers, tasks: Iterator[Task], results: Results, progress: bool) -> None:
    members = results.grid.size
    initial = members - len(results.members_to_run)
    bar = ProgressBar(progress, total=members, initial=initial, unit="member", desc="sweep")

    def record(records: Sequence[MemberRecord]) -> None:
        results.take_records(records)
        results.write_to_store()
        bar.advance(len(records))

    error: BaseException | None = None
    try:
        workers.run_all(tasks, record)
    except BaseException as failure:
        error = failure
    with Interrupts():  # A second Ctrl-C waits.
        bar.close()
        results.write_to_store(final=True)
        if isinstance(error, KeyboardInterrupt):
            status = results["status"]
            advice = "were done; give a store to keep them"
            if results.store is not None:
                advice = f"are in {results.store.path}; repeat the sweep to compute the rest"
            raise KeyboardInterrupt(
                f"{int((status != PENDING).sum())} of {status.size} members {advice}"
            ) from None
        if error is not None:
            raise error


def make_probe_members(make: MemberMaker, grid: Grid) -> dict[int, Member]:
    """Make members, by their index, among which every swept value occurs."""
    indices = np.arange(grid.size)
    if grid.size > _MOST_CHECKED:
        most = _MOST_CHECKED // len(grid.axes)
        # These are the steps in the flat index from a member to the next along each axis.
        steps = [math.prod(grid.shape[k + 1 :]) for k in range(len(grid.shape))]
        offsets = [
            step * np.linspace(0, n - 1, min(n, most)).astype(int)
            for step, n in zip(steps, grid.shape, strict=True)
        ]
        indices = np.unique(np.concatenate([[0], *offsets]))
    members = {index: _make_member(make, grid, index) for index in indices.tolist()}
    for member in members.values():
        name = member.settings["integrator"]
        if name not in ("auto", None) and warn_of_order(name, member.scene):
            break
    return members


def _make_member(make: MemberMaker, grid: Grid, index: int) -> Member:
    """Make the member with an index; a ValueError or TypeError names what cannot be run."""
    values = grid.member_values(index)
    try:
        return make(index, values)
    except (ValueError, TypeError) as error:
        if not values:
            raise
        text = ", ".join(f"{name}={value!r}" for name, value in values.items())
        raise type(error)(f"over has the member {text} that cannot be run: {error}") from error


@dataclass(frozen=True)
class Task:
    """Members of a sweep, and the metrics of each."""

    members: Sequence[Member]
    metrics: Metrics
    every: int | float | None = None
    threads: int | None = 1


def deal_tasks(
    make: MemberMaker,
    grid: Grid,
    metrics: Metrics,
    options: SweepOptions,
    pending: np.ndarray,
    workers: Workers,
    members: dict[int, Member],
) -> Iterator[Task]:
    """Deal the pending members into tasks of at most a batch, each of one shape and method.

    With a metric that needs references, tasks have members of equal physics instead, because they
    share a reference. `members` has those that are made already.
    """
    needs_references = "error" in metrics
    if needs_references:
        most = LARGEST_BATCH
        names = [name for name in grid.names if name not in NUMERICS]
    else:
        most = max(1, min(LARGEST_BATCH, len(pending) // (_LEAST_TASKS * workers.count)))
        names = [name for name in grid.names if name in ("shape", "scene", *RUN)]

    def describe_kind(index: int) -> str:
        """Describe the values in which members of a task are equal."""
        values = grid.member_values(index)
        if "scene" in names and not needs_references:
            values["scene"] = values["scene"].cloth.shape
        return repr([values[name] for name in names])

    every = options.every if any(metrics.values()) else None  # Metrics by name need no frames.
    threads = workers.threads_per_task(len(pending))
    indices = pending.tolist()
    groups = [indices]
    if names:
        groups = [
            list(group) for _, group in groupby(sorted(indices, key=describe_kind), describe_kind)
        ]
    for group in groups:
        for first in range(0, len(group), most):
            batch = [
                members.pop(index) if index in members else _make_member(make, grid, index)
                for index in group[first : first + most]
            ]
            yield Task(batch, metrics, every, threads)


class Stopped(Exception):
    """An order to stop the sweep, which abandons members in progress."""


def run_task(task: Task, pause: Callable[[], None] | None = None) -> list[MemberRecord]:
    """Run the members of a task, and return their records.

    `pause` is called from time to time. If it raises Stopped, finished members are returned.
    """
    records: list[MemberRecord] = []
    token = PAUSE.set(pause)
    try:
        with suppress(Stopped):
            records.extend(_run_members(task))
    finally:
        PAUSE.reset(token)
    return records


def _run_members(task: Task) -> Iterator[MemberRecord]:
    """Run members side by side where they share a call, else one by one."""
    batches = dict[Any, list[Member]]()
    for member in task.members:
        key: tuple[Any, ...] = (member.scene.cloth.shape, id(member.settings), member.dt)
        # Error control has steps of its own for each member, and a member may diverge.
        if member.dt is None or member.dt > member.max_stable_dt:
            key = (*key, member.index)
        batches.setdefault(key, []).append(member)
    for members in batches.values():
        try:
            runs, errors = _run_batch(members, task)
        except (ValueError, TypeError) as error:
            message = f"{type(error).__name__}: {error}"
            yield from [MemberRecord(member.index, FAILED, message=message) for member in members]
            continue
        for k, (member, run) in enumerate(zip(members, runs, strict=True)):
            yield _make_record(member, run, errors.get(k), task)


def _run_batch(
    members: Sequence[Member], task: Task
) -> tuple[Sequence[Run], Mapping[int, Failure]]:
    """Run the members of a batch, and return errors of those that did not come to their end."""
    settings = members[0].settings
    dt = members[0].dt
    if dt is None:
        scene = members[0].scene
        try:
            return [simulate(scene, **settings, every=task.every, threads=task.threads)], {}
        except (UnstableError, ContactError) as error:
            return [error.run], {0: error}
    options = Options(
        settings["integrator"], settings["precision"], task.threads, settings["kernel"]
    )
    job = Job(
        [member.scene for member in members],
        True,
        settings["duration"],
        options,
        frames=Frames(task.every),
        force=settings["force"],
        dt=dt,
        own_step=True,  # The results have each member's limit, so nothing warns of it.
    )
    return run_batch(job)


def _make_record(member: Member, run: Run, error: Failure | None, task: Task) -> MemberRecord:
    record = MemberRecord(member.index, DONE, max_stable_dt=member.max_stable_dt)
    if error is not None:
        record.status = UNSTABLE
        # The message is that of a run without others beside it.
        record.message = str(dataclasses.replace(error, member=None))
        record.unstable_step = error.step
        record.unstable_time = error.time
        return record
    if member.dt is None:
        record.max_stable_dt = stable_dt(member.scene, run.report["integrator"])
    reference = None
    if "error" in task.metrics:
        settings = member.settings
        reference = compute_reference(
            member.scene, settings["duration"], task.threads, settings["force"]
        )
        record.message = reason_without_error(run, reference)
    for name, function in task.metrics.items():
        try:
            if function is None:
                metric = METRICS[name]
                record.values.update(zip(metric.variables, metric.compute(run, reference)))
            else:
                record.values |= compute_variables(name, function, run)
        except Stopped:
            raise
        except Exception as failure:  # A user's function may raise any; other members go on.
            message = f"metric {name!r}: {type(failure).__name__}: {failure}"
            return dataclasses.replace(record, status=FAILED, message=message, values={})
    return record


class Workers:
    """The executor of tasks, and the number of its workers."""

    def __init__(self, executor: Any, threads: int | None) -> None:
        from concurrent.futures import Executor, ThreadPoolExecutor

        if threads is not None:
            threads = check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
        self.threads = threads
        self.own = executor is None
        self._stop = threading.Event()
        self.count = int(getattr(executor, "_max_workers", _WORKERS))
        if executor is None:
            self.count = threads or available_thread_count()
            self.executor: Executor = ThreadPoolExecutor(self.count, "clothsim-sweep")
        elif isinstance(executor, Executor):
            self.executor = executor
        elif callable(getattr(executor, "get_executor", None)):  # a distributed.Client
            self.count = int(sum(executor.nthreads().values())) or _WORKERS
            self.executor = executor.get_executor(pure=False)
        else:
            requirement = "None, a concurrent.futures.Executor or a dask.distributed Client"
            raise TypeError(f"executor must be {requirement}, got {check.value_text(executor)}")

    def _stop_after_sweep(self) -> None:
        """Stop a task on a thread of this process where the sweep has ended."""
        if self._stop.is_set():
            raise Stopped

    def threads_per_task(self, members: int) -> int | None:
        """Return the threads of each task: one, or all threads (None) for a single member."""
        if not self.own:
            return self.threads or 1
        return self.threads if members <= 1 else 1

    def run_all(self, tasks: Iterator[Task], record: Callable[[list[MemberRecord]], None]) -> None:
        """Execute all tasks, and call `record` in this thread with the results of each.

        If Ctrl-C or a broken pool ends this early, waiting tasks are cancelled and finished tasks
        are recorded before the error is raised.
        """
        from concurrent.futures import FIRST_COMPLETED, wait

        run = partial(run_task, pause=self._stop_after_sweep) if self.own else run_task
        futures: set[Future[list[MemberRecord]]] = set()
        try:
            while True:
                while len(futures) < _MOST_TASKS and (task := next(tasks, None)) is not None:
                    futures.add(self.executor.submit(run, task))
                if not futures:
                    return
                for future in wait(futures, return_when=FIRST_COMPLETED).done:
                    futures.remove(future)
                    record(future.result())
        except BaseException:
            with Interrupts():
                self._stop.set()
                for future in [future for future in futures if not future.cancel()]:
                    # Threads of this process give up within a tenth of a second. Nothing waits for
                    # other processes.
                    if (self.own or future.done()) and future.exception() is None:
                        record(future.result())
                raise

    def close(self) -> None:
        if self.own:
            self.executor.shutdown()
