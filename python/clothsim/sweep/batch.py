"""Members side by side: one `Stepper` for all that share shape, step and numerics."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence

from ..errors import ContactError, UnstableError
from ..measures import penetration
from ..stepping import Stepper
from .contact import ContactWatch
from .member import Floats, Member, Outcome
from .timing import frame_times, pieces

_SECONDS_BETWEEN_LOOKS = 0.1  # at whether the sweep is to stop
_FIRST_STEPS = 64


_OF_ERRORS = ("time", "point", "x", "v")


class Stopped(Exception):
    """The sweep is to stop; the batch is given up."""


class _Watched:
    """A member of the batch that still runs, and what is watched of it."""

    def __init__(self, member: Member, needs: frozenset[str]) -> None:
        self.outcome = Outcome(member)
        self.penetrates = "penetration" in needs and bool(member.scene.spheres)
        self.contact = ContactWatch(member) if "contact" in needs else None

    def look(self, t: float, x: Floats, v: Floats, dt: float, steps: int) -> None:
        outcome = self.outcome
        if self.penetrates:
            for sphere in outcome.scene.spheres:
                depth = penetration(x, sphere, t)
                points, triangles = outcome.penetration
                outcome.penetration = (
                    max(points, float(depth["points"])), max(triangles, float(depth["triangles"])),
                )  # fmt: skip
        if self.contact is not None:
            self.contact.look(t, x, v, dt, steps)

    def store(self, t: float, x: Floats, v: Floats) -> None:
        self.outcome.t.append(t)
        self.outcome.x.append(x)
        self.outcome.v.append(v)


def run_batch(
    members: Sequence[Member],
    needs: frozenset[str],
    *,
    every: int | float | None = None,
    sampling: int = 32,
    threads: int | None = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Outcome]:
    """Run members whose `batch_key` differs in nothing but the scene; as `simulate` would each.

    A member that diverges leaves the batch; the others go on from the same bits.

    Parameters
    ----------
    members : sequence of Member
    needs : frozenset of str
        What is watched; see `Metric`.
    every : int, float or None
        Frames, as for `simulate`; only the first and the last are kept unless `needs` has "frames".
    sampling : int
        At least so many states are looked at, if there are as many steps.
    threads : int, optional
        Threads of the core.
    stopped : callable
        Asked now and then; True gives up.

    Raises
    ------
    Stopped
        If `stopped` says so.
    """
    return _Batch(members, needs, every, sampling, threads, stopped).run()


class _Batch:
    def __init__(
        self,
        members: Sequence[Member],
        needs: frozenset[str],
        every: int | float | None,
        sampling: int,
        threads: int | None,
        stopped: Callable[[], bool],
    ) -> None:
        first = members[0]
        self.all = [_Watched(member, needs) for member in members]
        self.live = dict(enumerate(self.all))  # by the index into the batch
        self.stopped = stopped
        self.dt = first.dt
        self.times = frame_times(first.duration, first.dt, every)
        self.keep_frames = "frames" in needs
        self.stretches = "stretch" in needs
        self.sees_states = bool(needs & {"penetration", "contact"})
        self.stride = max(1, math.ceil(first.duration / first.dt) // sampling)
        self.stepper = Stepper([m.scene for m in members], threads=threads, **first.numerics)
        self.stepper._state.warned = True  # a sweep tells of each member's limit in its results
        self.total = 0  # steps since the start
        self.since_look = 0
        self.chunk = _FIRST_STEPS

    def run(self) -> list[Outcome]:
        self._store(0.0)
        self._look(self.dt)
        for begin, end in zip(self.times[:-1], self.times[1:], strict=True):
            for steps, dt in pieces(begin, end, self.dt):
                for now in self._advance(steps, dt):
                    if now == steps or self.total % self.stride == 0:
                        self._look(dt)
            if self.keep_frames or end == self.times[-1]:
                self._store(end)
        for watched in self.all:
            if watched.contact is not None:
                watched.outcome.first_contact = watched.contact.found
            watched.outcome.threads = self.stepper.threads
            watched.outcome.instruction_set = self.stepper.instruction_set
        return [watched.outcome for watched in self.all]

    def _advance(self, steps: int, dt: float) -> Iterator[int]:
        """Advance `steps` steps in chunks; gives how many are done after each."""
        done = 0
        while done < steps and self.live:
            if self.stopped():
                raise Stopped
            count = min(self.chunk, steps - done)
            if self.stretches or self.sees_states:
                count = min(count, self.stride - self.total % self.stride)
            start = time.perf_counter()
            try:
                self.stepper.advance(count, dt)
            except (UnstableError, ContactError) as error:
                count = error.step - 1
                self._account(count, time.perf_counter() - start)
                self._drop(error)
                done += count
                continue
            seconds = time.perf_counter() - start
            self._account(count, seconds)
            self.chunk = max(1, int(_SECONDS_BETWEEN_LOOKS * count / max(seconds, 1e-9)))
            done += count
            yield done

    def _account(self, steps: int, seconds: float) -> None:
        self.total += steps
        self.since_look += steps
        share = seconds / len(self.live)
        for watched in self.live.values():
            watched.outcome.steps += steps
            watched.outcome.seconds += share

    def _drop(self, error: UnstableError | ContactError) -> None:
        """Take the member that diverged out; all stand at the last good step."""
        assert error.member is not None
        self.stepper.freeze(error.member)
        outcome = self.live.pop(error.member).outcome
        # As the member alone would have raised it: of a run, not of a call or a batch.
        names = _OF_ERRORS + (("dt", "max_stable_dt") if isinstance(error, UnstableError) else ())
        values = {name: getattr(error, name) for name in names}
        outcome.error = type(error)(step=self.total + 1, **values)

    def _store(self, t: float) -> None:
        if self.live:
            x, v = self.stepper._arrays()
            for k, watched in self.live.items():
                watched.store(t, x[k], v[k])

    def _look(self, dt: float) -> None:
        if self.stretches:
            largest = self.stepper._state.core.largest_stretch()
            for k, watched in self.live.items():
                outcome = watched.outcome
                outcome.largest_stretch = max(outcome.largest_stretch, largest[k])
        if self.sees_states and self.live:
            t, (x, v) = self.stepper.time, self.stepper._arrays()
            for k, watched in self.live.items():
                watched.look(t, x[k], v[k], dt, self.since_look)
        self.since_look = 0
