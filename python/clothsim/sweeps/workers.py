"""Cut a sweep into tasks, and execute them on threads of this process or on the workers of an executor."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..accuracy.in_double import steps_in_double
from ..base import check
from ..base.interrupts import Interrupts
from ..methods.integration import warn_of_order
from ..model.scene import Scene
from ..stability.limit import max_stable_dt
from .grid import Grid
from .member import Member, Stopped, SweepOptions
from .task import Task, TaskResult, run_task

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

SHORTEST = 0.3  # s that a task should take: 0.2, and a margin for what is estimated
SHORTEST_HERE = 0.05  # s, on threads of this process, to which it costs nothing to send a task
LONGEST = 1.0  # s, unless `sweep` is given another: results are written as tasks end

_AHEAD = 2  # tasks a worker has waiting, so that none is idle while another is planned
_WORKERS_UNKNOWN = 32  # of an executor that does not say
_TASKS_LEFT = 2  # a worker, of the size of the next: tasks get shorter, so that all end together
_SECONDS_BETWEEN_SIGNS = 0.5  # that the sweep is alive, while no task ends

_CHECKED = 2048  # members that are made before anything is run, to find what cannot be
_POINTS_KEPT = 1 << 21  # mass points in all members that are kept; some 10 bytes each
_STEP_OF_REFERENCE = 3.0  # of dop853, over a step of RK4
_STEPS_TO_DIVERGE = 128  # about; most members above the limit are gone by then
_OVERHEAD = 1e4  # of a member, in steps of a mass point: 0.26 ms (benchmarks/sweep_throughput.py --plan)
_FIRST_GUESS = 2e-8  # s of a step of a mass point, until the first task ends


class Members:
    """The members of a sweep. As many are made at once as check every swept value, and show what all cost.

    A member is made once: members of the check are kept for their run, unless they are large.
    """

    def __init__(self, scene: Scene, grid: Grid, options: SweepOptions) -> None:
        self.scene, self.grid, self.options = scene, grid, options
        self.references = "reference" in options.needs
        most = _CHECKED // max(1, len(grid.axes))
        places = [np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)) for n in grid.shape]
        along = [indices[chosen] for indices, chosen in zip(grid.along(), places, strict=True)]
        checked = np.arange(grid.size) if grid.size <= _CHECKED else np.unique(np.concatenate([[0], *along]))
        self._made: dict[int, Member] = {}
        costs = np.full((3, grid.size), np.nan)
        room, warned = _POINTS_KEPT, False
        for index in checked.tolist():
            member = self._checked(index)
            warned = warned or (member.integrator != "auto" and bool(warn_of_order(member.integrator, member.scene)))
            costs[:, index] = self._costs(member)
            room -= member.points
            if room >= 0:
                self._made[index] = member
        if grid.size > len(checked):
            # Of others an estimate: the product of the changes along all axes.
            first = np.where(costs[:, 0] > 0, costs[:, 0], 1.0)[:, None]
            estimate = first.reshape(3, *[1] * len(grid.axes))
            for k, (indices, chosen, length) in enumerate(zip(along, places, grid.shape, strict=True)):
                ratios = [np.interp(np.arange(length), chosen, line) for line in costs[:, indices] / first]
                estimate = estimate * np.reshape(ratios, (3, *[length if j == k else 1 for j in range(len(grid.axes))]))
            costs = np.where(np.isnan(costs), estimate.reshape(3, -1), costs)
        self.points, steps, reference = costs
        shared = np.bincount(grid.physics)[grid.physics]
        self.weights: np.ndarray = self.points * (steps + reference / shared) + _OVERHEAD

    def _checked(self, index: int) -> Member:
        values = self.grid.member(index)
        try:
            return Member.make(index, self.scene, values, self.options)
        except (ValueError, TypeError) as error:
            if not values:
                raise
            which = ", ".join(f"{name}={value!r}" for name, value in values.items())
            raise type(error)(f"over has the member {which} that cannot be run: {error}") from error

    def _costs(self, member: Member) -> tuple[float, float, float]:
        """Mass points, and steps of the member and of its reference; a step of RK4 counts 1."""
        steps = min(member.expected_steps, _STEPS_TO_DIVERGE) if member.likely_unstable else member.expected_steps
        reference = steps_in_double(member.duration, max_stable_dt(member.scene)) if self.references else 0.0
        return member.points, steps, _STEP_OF_REFERENCE * reference

    def take(self, index: int) -> Member | None:
        """The member, which is kept no longer; None if it cannot be made, as its task will record."""
        if index in self._made:
            return self._made.pop(index)
        try:
            return Member.make(index, self.scene, self.grid.member(index), self.options)
        except (ValueError, TypeError):
            return None


class Planner:
    """Cuts pending members into tasks, each sized when it is asked for by the time that earlier tasks took.

    Members of one shape come together, so that a task shares its calls. Within a shape, members of
    one physics come together, so that members that differ in numerics share a reference.
    """

    def __init__(self, members: Members, pending: np.ndarray, workers: Workers, longest: float | None = None) -> None:
        self.members, self.count = members, workers.count
        self.shortest = SHORTEST_HERE if workers.own else SHORTEST
        self.longest = LONGEST if longest is None else longest
        physics = members.grid.physics[pending]
        order = np.lexsort((pending, physics, members.points[pending]))
        self.order, self.physics = pending[order], physics[order]
        # Two workers must not wait for one reference, unless there is nothing else to do.
        self.whole_physics = members.references and len(np.unique(physics)) >= 2 * self.count
        self.rate, self.known = _FIRST_GUESS, False  # seconds per weight
        self._before = np.concatenate([[0.0], np.cumsum(members.weights[self.order])])  # weight of all before a place
        self.threads = workers.threads_of(int(min(len(self.order), self._left(0) / self._target(0))))

    def _left(self, place: int) -> float:
        """Seconds that the members from this place on take."""
        return float(self._before[-1] - self._before[place]) * self.rate

    def _target(self, place: int) -> float:
        """Seconds that a task should take which begins at this place."""
        longest = self.longest if self.known else self.shortest
        return min(longest, max(self.shortest, self._left(place) / (_TASKS_LEFT * self.count)))

    def learn(self, result: TaskResult) -> None:
        """Take into account how long a task took."""
        if result.weight > 0 and not result.stopped:
            self.rate += (0.3 if self.known else 1.0) * (result.seconds / result.weight - self.rate)
            self.known = True

    def tasks(self) -> Iterator[Task]:
        """Iterate over the tasks. The last takes what would be too short for a task of its own."""
        begin, last = 0, len(self.order)
        while begin < last:
            end = int(np.searchsorted(self._before, self._before[begin] + self._target(begin) / self.rate))
            end = min(max(end, begin + 1), last)
            while end < last and self.whole_physics and self.physics[end] == self.physics[end - 1]:
                end += 1
            end = last if self._left(end) < self.shortest else end
            members, indices = self.members, self.order[begin:end].tolist()
            made = {index: member for index in indices if (member := members.take(index)) is not None}
            values = {index: members.grid.member(index) for index in indices}
            weight = float(self._before[end] - self._before[begin])
            yield Task(members.scene, members.options, values, weight, self.threads, made)
            begin = end


class Workers:
    """The executor of tasks, and the number of simultaneous tasks."""

    def __init__(self, executor: Any, threads: int | None) -> None:
        from concurrent.futures import Executor, ThreadPoolExecutor

        if threads is not None:
            threads = check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
        self.threads, self.own, self.client = threads, executor is None, None
        self._stop = threading.Event()
        self._under_way: dict[int, float] = {}  # by the number of the task
        if executor is None:
            self.count = threads or _core.available_threads()
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

    @property
    def under_way(self) -> float:
        """Steps of mass points that running tasks of this process have done."""
        return sum(list(self._under_way.values()))

    def _pause(self, task: int, cost: float) -> None:
        """The pause of tasks on threads of this process."""
        self._under_way[task] = self._under_way.get(task, 0.0) + cost
        if self._stop.is_set():
            raise Stopped

    def threads_of(self, tasks: int) -> int | None:
        """Threads of each task: one, or all threads (None) for a single task."""
        return (self.threads if tasks <= 1 else 1) if self.own else self.threads or 1

    def limit(self) -> int:
        """Largest number of simultaneous tasks. It changes, because a cluster may grow."""
        if self.client is not None:
            self.count = max(1, int(sum(self.client.nthreads().values())))
        return _AHEAD * self.count

    def run_all(
        self, planner: Planner, record: Callable[[TaskResult], None], meanwhile: Callable[[], None], sign: Callable[[], None]
    ) -> None:
        """Execute all tasks, and call `record` in this thread with each result.

        `meanwhile` is called once, when the first tasks are under way, and `sign` again and again. If Ctrl-C or a broken
        pool ends this early, waiting tasks are cancelled and finished tasks are recorded before the error is raised.
        """
        from concurrent.futures import FIRST_COMPLETED, wait

        waiting: dict[Future[TaskResult], int] = {}
        tasks = enumerate(planner.tasks())

        def fill() -> None:
            while len(waiting) < self.limit() and (numbered := next(tasks, None)) is not None:
                number, task = numbered
                function = partial(run_task, pause=partial(self._pause, number)) if self.own else run_task
                waiting[self.executor.submit(function, task)] = number

        try:
            fill()
            meanwhile()
            while waiting:
                for future in wait(waiting, _SECONDS_BETWEEN_SIGNS, FIRST_COMPLETED).done:
                    number = waiting.pop(future)
                    result = future.result()
                    self._under_way.pop(number, None)
                    record(result)
                    planner.learn(result)
                sign()
                fill()
        except BaseException:
            with Interrupts():
                self._stop.set()
                for future in [future for future in list(waiting) if not future.cancel()]:
                    # Threads of this process give up within a tenth of a second; others' are not waited for.
                    if (self.own or future.done()) and future.exception() is None:
                        record(future.result())
                raise

    def close(self) -> None:
        if self.own:
            self.executor.shutdown()
