"""A part of a sweep for one worker, in this process or another."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import ContactError, UnstableError
from ..machine.build import build_config
from ..model.scene import Scene
from .batch import Stopped, run_batch
from .controlled import run_controlled
from .member import DONE, FAILED, UNSTABLE, Member, Outcome, Record, Settings
from .reference import incomparable, references

# Members of a call; more save nothing, and all of their states are held at once.
_LARGEST_BATCH = 64


@dataclass(frozen=True)
class Task:
    """Members by their index and swept values; it pickles.

    `made` has members that are made already. Another process makes the members from their values, which are smaller to
    send.
    """

    scene: Scene
    settings: Settings
    members: tuple[tuple[int, Mapping[str, Any]], ...]
    weight: float = 0.0  # what it costs, in the planner's unit
    threads: int | None = 1
    made: Mapping[int, Member] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "made": {}}


@dataclass(frozen=True)
class TaskResult:
    """Result of a task, and the worker that computed it."""

    records: tuple[Record, ...]
    seconds: float
    weight: float
    host: str
    instruction_set: str
    stopped: bool = False


def run_task(task: Task, stopped: Callable[[], bool] | None = None) -> TaskResult:
    """Run the members of a task. If `stopped` returns True, only the finished members are returned."""
    start = time.perf_counter()
    records: list[Record] = []
    gave_up = False
    try:
        for record in _records(task, stopped or (lambda: False)):
            records.append(record)
    except Stopped:
        gave_up = True
    return TaskResult(
        tuple(records),
        time.perf_counter() - start,
        task.weight,
        platform.node(),
        str(build_config()["instruction_set"]),
        gave_up,
    )


def _records(task: Task, stopped: Callable[[], bool]) -> Iterable[Record]:
    settings = task.settings
    needs = frozenset(need for metric in settings.metrics for need in metric.needs)
    if settings.frames:
        needs |= {"frames"}
    options: dict[str, Any] = {
        "every": settings.every,
        "sampling": settings.sampling,
        "threads": task.threads,
        "stopped": stopped,
    }
    batches: dict[Any, list[Member]] = {}
    for index, values in task.members:
        try:
            member = task.made.get(index) or Member.make(index, task.scene, values, settings)
            if member.controlled:
                outcome = run_controlled(member, needs, **options)
                yield from _measured([outcome], task, needs, stopped)
                continue
        except (ValueError, TypeError) as error:
            yield Record(index, FAILED, message=f"{type(error).__name__}: {error}")
        else:
            batches.setdefault(member.batch_key, []).append(member)
    for members in batches.values():
        for first in range(0, len(members), _LARGEST_BATCH):
            outcomes = run_batch(members[first : first + _LARGEST_BATCH], needs, **options)
            yield from _measured(outcomes, task, needs, stopped)


def _measured(outcomes: list[Outcome], task: Task, needs: frozenset[str], stopped: Callable[[], bool]) -> Iterable[Record]:
    """The records of outcomes. Members that reached their end are compared with a reference, if a metric needs it."""
    if "reference" in needs:
        finished = [outcome for outcome in outcomes if outcome.error is None]
        solutions = references([o.member for o in finished], task.threads, stopped)
        for outcome, solution in zip(finished, solutions, strict=True):
            outcome.reference = solution
    return (_record(outcome, task.settings) for outcome in outcomes)


def _record(outcome: Outcome, settings: Settings) -> Record:
    member, error = outcome.member, outcome.error
    record = Record(member.index, DONE, max_stable_dt=member.max_stable_dt)
    if error is not None:
        return _diverged(record, error, settings)
    for metric in settings.metrics:
        try:
            record.values |= metric.compute(outcome)
        except Exception as failure:  # of a user's function: that member's loss alone
            record.status = FAILED
            record.message = f"metric {metric.name!r}: {type(failure).__name__}: {failure}"
            record.values.clear()
            return record
    if outcome.reference is not None:
        record.message = incomparable(outcome)
    if settings.frames:
        record.frames = np.array(outcome.x), np.array(outcome.v)
    return record


def _diverged(record: Record, error: UnstableError | ContactError, settings: Settings) -> Record:
    record.status = UNSTABLE
    record.unstable_step, record.unstable_time = error.step, error.time
    record.message = str(error)
    if any(metric.name == "stable" for metric in settings.metrics):
        record.values["stable"] = False
    return record
