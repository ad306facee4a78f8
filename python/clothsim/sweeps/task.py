"""The members of one task, run in this process or another: side by side where they share a call, else alone."""

from __future__ import annotations

import dataclasses
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engine.stepper import SilentStepper
from ..errors import ContactError, UnstableError
from ..machine.build import build_config
from ..model.scene import Scene
from ..run.between import Ends
from ..run.fixed_steps import pass_frames, sample_every
from ..run.frames import Schedule, as_every
from ..run.recording import PAUSE
from ..run.simulate import simulate
from ..stability.limit import max_stable_dt
from .member import DONE, FAILED, UNSTABLE, Member, Outcome, Pause, Record, Stopped, SweepOptions, never
from .metrics import incomparable, references

LARGEST_BATCH = 64
"""Members of a call; more save nothing, and all of their states are held at once."""

_SECONDS_BETWEEN_PAUSES = 0.1
_FIRST_STEPS = 64


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


def run_task(task: Task, pause: Pause = never) -> TaskResult:
    """Run the members of a task. If `pause` raises Stopped, only the finished members are returned."""
    records: list[Record] = []
    with suppress(Stopped):
        for outcome in _outcomes(task, pause, records):
            records.append(_record(outcome, task.options))
    return TaskResult(tuple(records), platform.node(), str(build_config()["instruction_set"]))


def _outcomes(task: Task, pause: Pause, failed: list[Record]) -> Iterator[Outcome]:
    """Outcomes of the members; a member that cannot be made or run is recorded in `failed`."""
    batches: dict[Any, list[Member]] = {}
    for index, values in task.values.items():
        try:
            member = task.made.get(index) or Member.make(index, task.scene, values, task.options)
            if member.controlled:
                yield from _compared([run_controlled(member, task.options, task.threads, pause)], task, pause)
            else:
                batches.setdefault(member.batch_key, []).append(member)
        except (ValueError, TypeError) as error:
            failed.append(Record(index, FAILED, message=f"{type(error).__name__}: {error}"))
    for members in batches.values():
        yield from _compared(Batch(members, task.options, task.threads, pause).run(), task, pause)


def _compared(outcomes: list[Outcome], task: Task, pause: Pause) -> list[Outcome]:
    """The outcomes. Members that reached their end get a reference, if a metric needs it."""
    for outcome in outcomes:
        if "reference" in task.options.needs and outcome.error is None:
            outcome.reference = references.of(outcome.member, task.threads, pause)
    return outcomes


def _record(outcome: Outcome, options: SweepOptions) -> Record:
    member, error = outcome.member, outcome.error
    record = Record(member.index, DONE, max_stable_dt=member.max_stable_dt)
    if error is not None:
        record.status, record.message = UNSTABLE, str(error)
        record.unstable_step, record.unstable_time = error.step, error.time
        return record
    for metric in options.metrics:
        try:
            record.values |= metric.compute(outcome)
        except Exception as failure:  # of a user's function: that member's loss alone
            message = f"metric {metric.name!r}: {type(failure).__name__}: {failure}"
            return dataclasses.replace(record, status=FAILED, message=message, values={})
    if outcome.reference is not None:
        record.message = incomparable(outcome)
    if options.frames:
        record.frames = np.array(outcome.x), np.array(outcome.v)
    return record


def run_controlled(member: Member, options: SweepOptions, threads: int | None = 1, pause: Pause = never) -> Outcome:
    """Run a member whose step is chosen by `rtol` and `atol`, alone."""
    outcome = Outcome(member)
    paused = PAUSE.set(pause)
    given = {**member.settings, "every": as_every(options.every), "threads": threads}
    try:
        run = simulate(member.scene, member.duration, **given)
    except (UnstableError, ContactError) as error:
        outcome.error = error
        return outcome
    finally:
        PAUSE.reset(paused)
    report = run.report
    limit = float(max_stable_dt(member.scene, report["integrator"]))
    outcome.member = dataclasses.replace(member, max_stable_dt=limit)
    outcome.itself = run
    outcome.watched = {
        "first_contact": report["first_contact"]["time"],
        "point_depth": report["penetration"]["points"],
        "triangle_depth": report["penetration"]["triangles"],
        "stretch": report["stretch"]["largest"],
        "energy_gained": report["energy"]["gained"],
    }
    outcome.steps, outcome.seconds = report["steps"], report["wall_time"]
    kept = slice(None) if "frames" in options.needs else slice(None, None, len(run.t) - 1)
    outcome.t, outcome.x, outcome.v = run.t[kept].tolist(), list(run.x[kept]), list(run.v[kept])
    return outcome


class Batch:
    """Members whose `batch_key` differs only in the scene, in one `Stepper`. Each gets the result of `simulate`.

    A member that diverges leaves the batch. The others continue with unchanged bits. `pause` is called from time to time.
    """

    def __init__(
        self, members: Sequence[Member], options: SweepOptions, threads: int | None = 1, pause: Pause = never
    ) -> None:
        first = members[0]
        self.all = [Outcome(member) for member in members]
        self.live = dict(enumerate(self.all))  # by the index into the batch
        self.pause, self.dt = pause, first.dt
        self.moments = Schedule.of_every(options.every).in_seconds(first.dt).moments(0.0, first.duration)
        self.keep_frames = "frames" in options.needs
        self.stepper = SilentStepper([m.scene for m in members], threads=threads, **first.numerics)
        # The results have each member's limit, so nothing warns of it.
        judge = self.stepper._state.judge
        judge.warned_of_dt = judge.warned_of_growth = True
        self.core = self.stepper._state.core
        if "watch" in options.needs:
            self.core.set_watch(sample_every(first.duration / first.dt), 0.0)
        self.total = 0  # steps since the start
        self.chunk = _FIRST_STEPS

    def run(self) -> list[Outcome]:
        """Run all members to their end; a Stopped that `pause` raises passes through."""
        self.store(0.0, 0.0)
        pass_frames(self, self.moments if self.keep_frames else [self.moments[0], self.moments[-1]], self.dt)
        for outcome, watched, evaluations in zip(self.all, self.core.watched, self.core.evaluations, strict=True):
            outcome.watched, outcome.state, outcome.evaluations = watched, self.stepper._state, evaluations
        return self.all

    def advance(self, steps: int, dt: float) -> None:
        """Advance `steps` steps in chunks."""
        done = 0
        while done < steps and self.live:
            self.pause()
            count = min(self.chunk, steps - done)
            start = time.perf_counter()
            error = None
            try:
                self.stepper.advance(count, dt)
            except (UnstableError, ContactError) as caught:
                error, count = caught, caught.step - 1
            seconds = time.perf_counter() - start
            self.total += count
            for outcome in self.live.values():
                outcome.steps += count
                outcome.seconds += seconds / len(self.live)
            if error is None:
                self.chunk = max(1, int(_SECONDS_BETWEEN_PAUSES * count / max(seconds, 1e-9)))
            else:
                self._drop(error)
            done += count

    def _drop(self, error: UnstableError | ContactError) -> None:
        """Exclude the diverged member; all members stand at the last good step."""
        assert error.member is not None
        self.stepper.freeze(error.member)
        outcome = self.live.pop(error.member)
        # As the member alone would have raised it: of a run, not of a call or a batch.
        outcome.error = dataclasses.replace(error, step=self.total + 1, member=None)

    def arrays_now(self) -> tuple[Any, Any]:
        """Positions and velocities of all members."""
        return self.stepper._arrays()

    def store(self, seconds: float, t: float) -> None:
        """Store the present state of each live member."""
        if self.live:
            self.core.sample()
            self._keep(t, dict(enumerate(zip(*self.arrays_now()))))

    def store_between(self, seconds: float, t: float, ends: Ends) -> None:
        """Store a frame between two steps of each live member."""
        self._keep(t, {k: ends.member(k).at(t, outcome.scene) for k, outcome in self.live.items()})

    def _keep(self, t: float, states: dict[int, tuple[Any, Any]]) -> None:
        for k, outcome in self.live.items():
            x, v = states[k]
            outcome.t.append(t)
            outcome.x.append(x)
            outcome.v.append(v)
