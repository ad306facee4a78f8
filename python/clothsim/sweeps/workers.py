"""Execute the tasks, on threads of this process or on the workers of an executor."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from .. import _core
from ..base import check
from . import planning
from .planning import Planner
from .task import TaskResult, run_task

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

_AHEAD = 2  # tasks a worker has waiting, so that none is idle while another is planned
_WORKERS_UNKNOWN = 32  # of an executor that does not tell


class Workers:
    """The executor of tasks, and the number of simultaneous tasks."""

    def __init__(self, executor: Any, threads: int | None) -> None:
        from concurrent.futures import Executor, ThreadPoolExecutor

        if threads is not None:
            threads = check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
        self.threads = threads
        self.stop: threading.Event | None = None
        self._close: Callable[[], Any] = lambda: None
        self._client: Any = None
        if executor is None:
            self.count = threads or _core.available_threads()
            self.stop = threading.Event()
            self.executor: Executor = ThreadPoolExecutor(self.count, "clothsim-sweep")
            self._close = self.executor.shutdown
            return
        if isinstance(executor, Executor):
            self.executor = executor
            self.count = int(getattr(executor, "_max_workers", _WORKERS_UNKNOWN))
        elif callable(getattr(executor, "get_executor", None)):  # a distributed.Client
            self._client = executor
            self.executor = executor.get_executor(pure=False)
            self.count = self._cluster_threads()
        else:
            raise TypeError(
                "executor must be None, a concurrent.futures.Executor or a dask.distributed "
                f"Client, got {check.shown(executor)}"
            )

    def _cluster_threads(self) -> int:
        return max(1, int(sum(self._client.nthreads().values())))

    @property
    def shortest_task(self) -> float:
        """Seconds that a task should take at least."""
        return planning.SHORTEST if self.stop is None else planning.SHORTEST_HERE

    def threads_of(self, tasks: int) -> int | None:
        """Threads of each task: one, or all threads (None) for a single task."""
        if self.stop is None:
            return self.threads or 1
        return self.threads if tasks == 1 else 1

    def limit(self) -> int:
        """Largest number of simultaneous tasks. It changes, because a cluster may grow."""
        if self._client is not None:
            self.count = self._cluster_threads()
        return _AHEAD * self.count

    def submit(self, task: Any) -> Future[TaskResult]:
        function = partial(run_task, stopped=self.stop.is_set) if self.stop else run_task
        return self.executor.submit(function, task)

    def close(self) -> None:
        self._close()


def run_all(
    workers: Workers, planner: Planner, record: Callable[[TaskResult], None], meanwhile: Callable[[], None] = lambda: None
) -> None:
    """Execute all tasks. `record` is called in this thread with each result.

    `meanwhile` is called once, before that, when the first tasks are under way.

    If Ctrl-C or a broken pool ends this early, waiting tasks are cancelled. Finished tasks are recorded before the
    error is raised.
    """
    finished: queue.SimpleQueue[Future[TaskResult]] = queue.SimpleQueue()
    waiting: set[Future[TaskResult]] = set()
    with _cleared(workers, waiting, finished, record):
        tasks = planner.tasks()
        _fill(workers, tasks, waiting, finished)
        meanwhile()
        while True:
            _fill(workers, tasks, waiting, finished)
            if not waiting:
                return
            future = finished.get()
            waiting.discard(future)
            result = future.result()
            record(result)
            planner.learn(result)


def _fill(
    workers: Workers, tasks: Iterator[Any], waiting: set[Future[TaskResult]], finished: queue.SimpleQueue[Future[TaskResult]]
) -> None:
    room = workers.limit() - len(waiting)
    for _ in range(room):
        task = next(tasks, None)
        if task is None:
            return
        future = workers.submit(task)
        waiting.add(future)
        future.add_done_callback(finished.put)


@contextmanager
def _cleared(
    workers: Workers,
    waiting: set[Future[TaskResult]],
    finished: queue.SimpleQueue[Future[TaskResult]],
    record: Callable[[TaskResult], None],
) -> Iterator[None]:
    try:
        yield
    except BaseException:
        if workers.stop is not None:
            workers.stop.set()
        left = {future for future in list(waiting) if not future.cancel()}
        for future in left:
            # Our own threads give up within a tenth of a second; others' are not waited for.
            if workers.stop is not None or future.done():
                if future.exception() is None:
                    record(future.result())
        raise
