"""Cut a sweep into tasks, and execute them on threads of this process or on the workers of an executor."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..base import check
from ..base.build import available_threads
from ..base.interrupts import Interrupts
from ..methods.integration import integrators, warn_of_order
from ..model.fields import RUN
from ..model.scene import Scene
from .grid import Grid, physics
from .member import Maker, Member, SweepOptions
from .task import LARGEST_BATCH, Stopped, Task, TaskResult, run_task

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

_AHEAD = 2  # tasks a worker has waiting, so that none is idle
_TASKS = 4  # a worker has at least so many, where there are enough members, so that all end together
_WORKERS_UNKNOWN = 32  # of an executor that does not say
_CHECKED = 2048  # members that are made before anything is run, to find what cannot be


def checked_members(scene: Scene, grid: Grid, options: SweepOptions) -> dict[int, Member]:
    """Members, by their index, among which every swept value occurs; a ValueError or TypeError names what cannot be run."""
    chosen = np.arange(grid.size)
    if grid.size > _CHECKED:
        most = _CHECKED // len(grid.axes)
        along = (indices[np.linspace(0, len(indices) - 1, min(len(indices), most)).astype(int)] for indices in grid.along())
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

    With a metric that needs references, members of one physics come together in place of that: they share a reference.
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
