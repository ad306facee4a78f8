"""Cut a sweep into tasks that are long enough for a worker."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..accuracy.in_double import steps_in_double
from ..base.clocks import seconds_per_step
from ..engine.stepper import SilentStepper
from ..stability.limit import max_stable_dt
from .grid import Grid
from .member import Members
from .task import Task, TaskResult

SHORTEST = 0.3  # s that a task should take: 0.2, and a margin for what is estimated
SHORTEST_HERE = 0.05  # s, on threads of this process, to which it costs nothing to send a task
LONGEST = 1.0  # s, unless `sweep` is told otherwise: results are written as tasks end
_TASKS_LEFT = 2  # a worker, of the size of the next: tasks get shorter, so that all end together
_STEPS_TIMED = 16
_UNKNOWN_COST = 2e-8  # s of a step of a mass point, where no step could be timed
_STEP_OF_REFERENCE = 3.0  # of dop853, over a step of RK4
_STEPS_TO_DIVERGE = 128  # about; most members above the limit are gone by then


class Planner:
    """Cuts pending members into tasks, sized by the time of earlier tasks.

    Members of one shape come together, so that a task shares its calls. Within a shape, members of
    one physics come together, so that members that differ in numerics share a reference.
    """

    def __init__(
        self,
        members: Members,
        pending: np.ndarray,
        workers: int,
        longest: float | None = None,
        shortest: float | None = None,
    ) -> None:
        self.members = members
        scene, grid, settings = members.scene, members.grid, members.settings
        self.scene, self.grid, self.settings = scene, grid, settings
        self.threads: int | None = 1
        self.references = any("reference" in metric.needs for metric in settings.metrics)
        points = _numbers(grid, "shape", scene.cloth.shape, math.prod)
        if "scene" in grid.names:
            points = _numbers(grid, "scene", scene, lambda s: math.prod(s.cloth.shape))
        limit = max_stable_dt(scene)
        # Roughly, for the bar and the tasks' size; `_weight` knows better when its time comes.
        self.weights = points * self._steps(limit)
        physics = grid.physics[pending]
        self.order = pending[np.lexsort((pending, physics, points[pending]))]
        # Two workers must not wait for one reference, unless there is nothing else to do.
        self.whole_physics = self.references and len(np.unique(physics)) >= 2 * workers
        self.seconds_per_weight = self._try_out() if len(pending) else 1.0
        # Of this and all later members, by its place in the order.
        self._left = np.cumsum(self.weights[self.order][::-1])[::-1]
        self.workers = workers
        self.longest = LONGEST if longest is None else longest
        self.shortest = SHORTEST if shortest is None else shortest

    @property
    def expected_tasks(self) -> int:
        """Approximate number of tasks."""
        if not len(self.order):
            return 1
        return max(1, int(self._left[0] * self.seconds_per_weight / self._target(0)))

    def _target(self, place: int) -> float:
        """Seconds that a task should take, by its place in the order."""
        left = float(self._left[place]) * self.seconds_per_weight
        return min(self.longest, max(self.shortest, left / (_TASKS_LEFT * self.workers)))

    def _steps(self, limit: float) -> np.ndarray:
        """Steps per member; members that share a reference share its steps."""
        settings = self.settings
        duration = _numbers(self.grid, "duration", settings.duration, float)
        default = settings.dt or (limit / 2 if math.isfinite(limit) else settings.duration)
        steps = duration / _numbers(self.grid, "dt", default, lambda dt: default if dt is None else float(dt))
        if self.references:
            shared = np.bincount(self.grid.physics)[self.grid.physics]
            steps = steps + _STEP_OF_REFERENCE * steps_in_double(settings.duration, limit) / shared
        return np.asarray(np.maximum(steps, 1.0))

    def _try_out(self) -> float:
        """Seconds per unit of weight, measured with the first valid member."""
        index = int(self.order[0])
        try:
            member = self.members.make(index)
        except (ValueError, TypeError):
            return _UNKNOWN_COST
        if member.controlled:
            member = replace(member, dt=member.duration, integrator="rk4")
        stepper = SilentStepper(member.scene, threads=1, **member.numerics)
        dt = min(member.dt, member.max_stable_dt / 4)
        seconds = seconds_per_step(lambda steps: stepper.advance(steps, dt), math.inf, 3, _STEPS_TIMED)
        return seconds / math.prod(member.scene.cloth.shape) or _UNKNOWN_COST

    def learn(self, result: TaskResult) -> None:
        """Take into account how long a task took."""
        if result.weight > 0 and not result.stopped:
            measured = result.seconds / result.weight
            self.seconds_per_weight += 0.3 * (measured - self.seconds_per_weight)

    def tasks(self) -> Iterator[Task]:
        """Iterate over the tasks. Each is sized when it is requested, and a short last task joins the task before."""
        held: tuple[list[int], float] | None = None
        for indices, weight in self._groups():
            if held is None:
                held = indices, weight
            elif weight * self.seconds_per_weight < self.shortest:
                held = held[0] + indices, held[1] + weight
            else:
                yield self._task(*held)
                held = indices, weight
        if held is not None:
            yield self._task(*held)

    def _groups(self) -> Iterator[tuple[list[int], float]]:
        """Indices of members for a task of sufficient length, and their cost."""
        physics = self.grid.physics
        indices: list[int] = []
        weight = target = 0.0
        for k, index in enumerate(self.order):
            new = k == 0 or physics[index] != physics[self.order[k - 1]]
            if not indices:
                target = self._target(k)
            elif weight * self.seconds_per_weight >= target and (new or not self.whole_physics):
                yield indices, weight
                indices, weight, target = [], 0.0, self._target(k)
            indices.append(int(index))
            weight += self._weight(int(index), new)
        if indices:
            yield indices, weight

    def _weight(self, index: int, new_physics: bool) -> float:
        """Cost of a member, in steps of a mass point."""
        try:
            member = self.members.make(index)
        except (ValueError, TypeError):
            return 0.0
        steps = member.expected_steps
        if member.likely_unstable:
            steps = min(steps, _STEPS_TO_DIVERGE)
        if self.references and new_physics:
            steps += _STEP_OF_REFERENCE * steps_in_double(member.duration, max_stable_dt(member.scene))
        return steps * math.prod(member.scene.cloth.shape)

    def _task(self, indices: list[int], weight: float) -> Task:
        members = tuple((k, self.grid.member(k)) for k in indices)
        made = {k: member for k in indices if (member := self.members.take(k)) is not None}
        return Task(self.scene, self.settings, members, weight, self.threads, made)


def _numbers(grid: Grid, name: str, default: Any, number: Any) -> np.ndarray:
    """A number per member, made from its value of `name`."""
    result = np.zeros(())
    for axis in grid.axes:
        places = [number(v) for v in axis.column(name)] if name in axis.names else [0.0] * len(axis)
        result = result[..., None] + np.array(places, float)
    if name not in grid.names:
        result = result + number(default)
    return np.broadcast_to(result, grid.shape).ravel()
