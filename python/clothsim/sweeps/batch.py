"""Members side by side: one `Stepper` for members of equal shape, step and numerics."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from ..engine.stepper import SilentStepper
from ..errors import ContactError, UnstableError
from ..run.between import Ends
from ..run.fixed_steps import pass_frames, sample_every
from ..run.frames import Schedule
from .member import Member, Outcome

_SECONDS_BETWEEN_LOOKS = 0.1  # at whether the sweep is to stop
_FIRST_STEPS = 64


_OF_ERRORS = ("time", "point", "x", "v")


class Stopped(Exception):
    """The sweep is to stop; the batch is given up."""


def run_batch(
    members: Sequence[Member],
    needs: frozenset[str],
    *,
    every: int | float | None = None,
    sampling: int = 32,
    threads: int | None = 1,
    stopped: Callable[[], bool] = lambda: False,
) -> list[Outcome]:
    """Run members whose `batch_key` differs only in the scene. Each gets the result of `simulate`.

    A member that diverges leaves the batch. The others continue with unchanged bits.

    Parameters
    ----------
    members : sequence of Member
    needs : frozenset of str
        Watched quantities; see `Metric`.
    every : int, float or None
        Frames, as for `simulate`; only the first and the last are kept unless `needs` has "frames".
    sampling : int
        Least number of states at which triangles and stretches are sampled, if there are enough steps.
    threads : int, optional
        Threads of the core.
    stopped : callable
        Called from time to time; True ends the batch.

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
        self.all = [Outcome(member) for member in members]
        self.live = dict(enumerate(self.all))  # by the index into the batch
        self.stopped = stopped
        self.dt = first.dt
        self.moments = Schedule.of_every(every).in_seconds(first.dt).moments(0.0, first.duration)
        self.keep_frames = "frames" in needs
        self.stepper = SilentStepper([m.scene for m in members], threads=threads, **first.numerics)
        # A sweep tells of each member's limit in its results.
        judge = self.stepper._state.judge
        judge.warned_of_dt = judge.warned_of_growth = True
        self.core = self.stepper._state.core
        if "watch" in needs:
            self.core.set_watch(sample_every(first.duration / first.dt, sampling), 0.0)
        self.total = 0  # steps since the start
        self.chunk = _FIRST_STEPS

    def run(self) -> list[Outcome]:
        self.store(0.0, 0.0)
        pass_frames(self, self.moments if self.keep_frames else [self.moments[0], self.moments[-1]], self.dt)
        state = self.stepper._state
        for outcome, watched, evaluations in zip(self.all, self.core.watched, self.core.evaluations, strict=True):
            outcome.watched, outcome.state = watched, state
            outcome.evaluations = evaluations
        return self.all

    def advance(self, steps: int, dt: float) -> None:
        """Advance `steps` steps in chunks."""
        done = 0
        while done < steps and self.live:
            if self.stopped():
                raise Stopped
            count = min(self.chunk, steps - done)
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

    def _account(self, steps: int, seconds: float) -> None:
        self.total += steps
        share = seconds / len(self.live)
        for outcome in self.live.values():
            outcome.steps += steps
            outcome.seconds += share

    def _drop(self, error: UnstableError | ContactError) -> None:
        """Exclude the diverged member; all members stand at the last good step."""
        assert error.member is not None
        self.stepper.freeze(error.member)
        outcome = self.live.pop(error.member)
        # As the member alone would have raised it: of a run, not of a call or a batch.
        names = _OF_ERRORS + (("dt", "max_stable_dt", "term") if isinstance(error, UnstableError) else ())
        values = {name: getattr(error, name) for name in names}
        outcome.error = type(error)(step=self.total + 1, **values)

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
