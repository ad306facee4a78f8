"""A sweep's tasks: how it is cut into them, how one runs its members, and the threads or executor that run all.

Members of a task run side by side where they share a call, else alone.
"""

from __future__ import annotations

import dataclasses
import math
import platform
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..base import check
from ..base.build import available_threads, build_config
from ..base.interrupts import Interrupts
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..methods.integrators import integrators, warn_of_order
from ..model.fields import RUN
from ..model.scene import Scene
from ..run.frames import Schedule, as_every
from ..run.result import Run
from ..run.simulate import run_batch, simulate
from ..run.trajectory import PAUSE, Failure, Job, RunOptions
from .grid import Grid, physics
from .member import DONE, FAILED, UNSTABLE, Maker, Member, Record, SweepOptions
from .metrics import incomparable, reference_of

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

LARGEST_BATCH = 64
"""Members of a call; more save nothing, and all of their states are held at once."""


class Stopped(Exception):
    """The sweep must stop; members in progress are abandoned."""


@dataclass(frozen=True)
class Task:
    """Members by their index and swept values; another process makes them from the values, which are smaller to send."""

    scene: Scene
    options: SweepOptions
    values: Mapping[int, Mapping[str, Any]]
    threads: int | None = 1
    made: Mapping[int, Member] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "made": {}}


@dataclass(frozen=True)
class TaskResult:
    """Result of a task, and the worker that computed it."""

    records: tuple[Record, ...]
    host: str
    instruction_set: str


def run_task(task: Task, pause: Callable[[], None] | None = None) -> TaskResult:
    """Run the members of a task. If `pause`, called from time to time, raises Stopped, the finished members come back."""
    records: list[Record] = []
    before = PAUSE.set(pause)
    try:
        with suppress(Stopped):
            records.extend(_records(task))
    finally:
        PAUSE.reset(before)
    return TaskResult(tuple(records), platform.node(), str(build_config()["instruction_set"]))


def _records(task: Task) -> Iterator[Record]:
    make, needs, batches = Maker(task.scene, task.options), task.options.needs, dict[Any, list[Member]]()
    for index, values in task.values.items():
        member = task.made.get(index)
        try:
            member = member or make(index, values)
        except (ValueError, TypeError) as error:
            yield _failed(index, error)
            continue
        alone = None if member.dt <= member.max_stable_dt else index  # with error control, or where it may diverge
        key = member.scene.cloth.shape, id(member.settings), member.dt, alone
        batches.setdefault(key, []).append(member)
    for members in batches.values():
        try:
            runs, errors = _run(members, task, "frames" in needs)
        except (ValueError, TypeError) as error:
            yield from [_failed(member.index, error) for member in members]
            continue
        for k, (member, run) in enumerate(zip(members, runs, strict=True)):
            yield _record(member, run, errors.get(k), task, "reference" in needs)


def _failed(index: int, error: Exception) -> Record:
    return Record(index, FAILED, message=f"{type(error).__name__}: {error}")


def _run(members: Sequence[Member], task: Task, frames: bool) -> tuple[Sequence[Run], Mapping[int, Failure]]:
    """Runs of members of one batch, and errors of those that did not come to their end."""
    first, settings, every = members[0], members[0].settings, task.options.every
    if settings.controlled:
        try:
            run = simulate(first.scene, settings.duration, every=as_every(every), threads=task.threads, **first.arguments)
            return [run], {}
        except (UnstableError, ContactError) as error:
            return [error.run], {0: error}
    options = RunOptions(**settings.numerics, threads=task.threads)
    schedule = Schedule.of_every(every if frames else None)
    # The results have each member's limit, so nothing warns of it.
    scenes = [one.scene for one in members]
    return run_batch(Job(scenes, True, settings.duration, options, schedule, dt=first.dt, own_step=True))


def _record(member: Member, run: Run, error: Failure | None, task: Task, compared: bool) -> Record:
    record, options = Record(member.index, DONE, max_stable_dt=member.max_stable_dt), task.options
    if error is not None:
        record.status, record.message = UNSTABLE, str(dataclasses.replace(error, member=None))  # as of the run alone
        record.unstable_step, record.unstable_time = error.step, error.time
        return record
    if member.settings.controlled:
        record.max_stable_dt = stable_dt(member.scene, run.report["integrator"])
    reference = reference_of(member.scene, member.settings.duration, task.threads) if compared else None
    for metric in options.metrics:
        try:
            record.values |= metric.compute(run, reference)
        except Stopped:
            raise
        except Exception as failure:  # of a user's function: that member's loss alone
            message = f"metric {metric.name!r}: {type(failure).__name__}: {failure}"
            return dataclasses.replace(record, status=FAILED, message=message, values={})
    if reference is not None:
        record.message = incomparable(run, reference)
    if options.frames:
        record.frames = run.x, run.v
    return record


_AHEAD = 2  # tasks a worker has waiting, so that none is idle
_TASKS = 4  # a worker has at least so many, where there are enough members, so that all end together
_WORKERS_UNKNOWN = 32  # of an executor that does not say
_CHECKED = 2048  # members that are made before anything is run, to find what cannot be


def checked_members(scene: Scene, grid: Grid, options: SweepOptions) -> dict[int, Member]:
    """Members, by their index, among which every swept value occurs; a ValueError or TypeError names what cannot be run."""
    chosen = np.arange(grid.size)
    if grid.size > _CHECKED:
        most = _CHECKED // len(grid.axes)
        steps = [math.prod(grid.shape[k + 1 :]) for k in range(len(grid.shape))]  # between members along each axis
        along = [step * np.linspace(0, n - 1, min(n, most)).astype(int) for step, n in zip(steps, grid.shape, strict=True)]
        chosen = np.unique(np.concatenate([[0], *along]))
    make, made = Maker(scene, options), dict[int, Member]()
    for index, values in grid.members(chosen.tolist()).items():
        try:
            made[index] = make(index, values)
        except (ValueError, TypeError) as error:
            if not values:
                raise
            which = ", ".join(f"{name}={value!r}" for name, value in values.items())
            raise type(error)(f"over has the member {which} that cannot be run: {error}") from error
    lossy = {name for name, one in integrators().items() if one.order_damped < one.order}
    for member in made.values():
        if (name := member.settings.numerics["integrator"]) in lossy and warn_of_order(name, member.scene):
            break
    return made


def tasks(
    scene: Scene, grid: Grid, options: SweepOptions, pending: np.ndarray, workers: Workers, made: dict[int, Member]
) -> Iterator[Task]:
    """The pending members in tasks of at most a batch, each of one shape and method.

    With a metric that needs references, tasks group members with equal physics instead, because they share a reference.
    """
    most = max(1, min(LARGEST_BATCH, len(pending) // (_TASKS * workers.count)))
    threads, chosen, groups = workers.threads_of(len(pending)), pending.tolist(), dict[str, dict[int, Any]]()
    names = [name for name in ("shape", "scene", *RUN) if name in grid.names]
    if "reference" in options.needs:
        names = []
        chosen.sort(key=lambda index: physics(grid.members([index])[index]))
    for index in chosen:
        values, kind = grid.members([index])[index], ""
        for name in names:
            kind += repr(values[name].cloth.shape if name == "scene" else values[name])
        group = groups.setdefault(kind, {})
        group[index] = values
        if len(group) == most:
            yield Task(scene, options, groups.pop(kind), threads, {k: made.pop(k) for k in group if k in made})
    for group in groups.values():
        yield Task(scene, options, group, threads, {k: made.pop(k) for k in group if k in made})


class Workers:
    """The executor of tasks, and the number of simultaneous tasks."""

    def __init__(self, executor: Any, threads: int | None) -> None:
        from concurrent.futures import Executor, ThreadPoolExecutor

        if threads is not None:
            threads = check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
        self.threads, self.own, self.client = threads, executor is None, None
        self._stop = threading.Event()
        if executor is None:
            self.count = threads or available_threads()
            self.executor: Executor = ThreadPoolExecutor(self.count, "clothsim-sweep")
        elif isinstance(executor, Executor):
            self.executor = executor
            self.count = int(getattr(executor, "_max_workers", _WORKERS_UNKNOWN))
        elif callable(getattr(executor, "get_executor", None)):  # a distributed.Client
            self.client = executor
            self.executor = executor.get_executor(pure=False)
            self.limit()
        else:
            accepted = "None, a concurrent.futures.Executor or a dask.distributed Client"
            raise TypeError(f"executor must be {accepted}, got {check.shown(executor)}")

    def _pause(self) -> None:
        """The pause of tasks on threads of this process."""
        if self._stop.is_set():
            raise Stopped

    def threads_of(self, members: int) -> int | None:
        """Threads of each task: one, or all threads (None) for a single member."""
        return (self.threads if members <= 1 else 1) if self.own else self.threads or 1

    def limit(self) -> int:
        """Largest number of simultaneous tasks. It changes, because a cluster may grow."""
        if self.client is not None:
            self.count = max(1, int(sum(self.client.nthreads().values())))
        return _AHEAD * self.count

    def run_all(self, tasks: Iterator[Task], record: Callable[[TaskResult], None]) -> None:
        """Execute all tasks, and call `record` in this thread with each result.

        If Ctrl-C or a broken pool ends this early, waiting tasks are cancelled and finished tasks are recorded before the
        error is raised.
        """
        from concurrent.futures import FIRST_COMPLETED, wait

        run = partial(run_task, pause=self._pause) if self.own else run_task
        waiting: set[Future[TaskResult]] = set()
        try:
            while True:
                while len(waiting) < self.limit() and (task := next(tasks, None)) is not None:
                    waiting.add(self.executor.submit(run, task))
                if not waiting:
                    return
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    waiting.remove(future)
                    record(future.result())
        except BaseException:
            with Interrupts():
                self._stop.set()
                for future in [future for future in waiting if not future.cancel()]:
                    # Threads of this process give up within a tenth of a second; others' are not waited for.
                    if (self.own or future.done()) and future.exception() is None:
                        record(future.result())
                raise

    def close(self) -> None:
        if self.own:
            self.executor.shutdown()
