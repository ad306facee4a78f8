"""The members of one task, run in this process or another: side by side where they share a call, else alone."""

from __future__ import annotations

import dataclasses
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from ..base.build import build_config
from ..errors import ContactError, UnstableError
from ..methods.bound import stable_dt
from ..model.scene import Scene
from ..run.frames import Schedule, as_every
from ..run.result import Run
from ..run.simulate import run_batch, simulate
from ..run.trajectory import PAUSE, Failure, Job, RunOptions
from .member import DONE, FAILED, UNSTABLE, Maker, Member, Record, SweepOptions
from .metrics import incomparable, reference_of

LARGEST_BATCH = 64
"""Members of a call; more save nothing, and all of their states are held at once."""


class Stopped(Exception):
    """The sweep is to stop; members under way are given up."""


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
