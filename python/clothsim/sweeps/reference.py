"""The solution that the metric "error" compares with.

`solve` makes it alone: RK4 in double with equal steps, at most 1/32 of the guaranteed stable step,
and again at twice that. Richardson extrapolation of order 4 gives x = fine + (fine - coarse) / 15.
The bound of its error is the distance of the two. While truncation rules, that is 15 times the
error of the finer alone; where rounding rules, it is the difference of two independent roundings.
After a contact the motion is chaotic: trajectories of nearby states part, and there is no solution
to compare with (`incomparable`).

It depends on the cloth alone, never on other members of a sweep. Members that differ in numerics
share it, and each process keeps the last references.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..engine.stepper import SilentStepper
from ..errors import UnstableError
from ..model.scene import Scene
from ..stability.limit import max_stable_dt
from .batch import Stopped
from .member import Floats, Member, Outcome
from .plain import digest

_PARTS_OF_LIMIT = 32
_STEPS_WITHOUT_LIMIT = 1024
_BYTES_KEPT = 1 << 27
_STEPS_BETWEEN_LOOKS = 512  # at whether the sweep is to stop


@dataclass(frozen=True)
class Reference:
    """Positions at the end [m] and a bound of their error [m]; NaN where there is none.

    `contact`: whether a sphere has responded on the way.
    """

    x: Floats
    error: float
    contact: bool = False


def incomparable(outcome: Outcome) -> str:
    """Why the member's trajectory cannot be compared with the reference's, or ""."""
    if not (outcome.contact or outcome.reference.contact):
        return ""
    whose = "the member" if outcome.contact else "the reference"
    return (
        f"metric 'error': a sphere has responded to a mass point of {whose}; after contact trajectories "
        "are chaotic and there is no reference; compare outcomes (penetration, first_contact, "
        "energy_drift) or take a shorter duration"
    )


def reference_steps(duration: float, limit: float) -> int:
    """The number of steps that the finer of the two solutions takes, an even number."""
    if not math.isfinite(limit):
        return _STEPS_WITHOUT_LIMIT
    return 2 * math.ceil(duration * _PARTS_OF_LIMIT / limit / 2)


def solve(scene: Scene, duration: float, threads: int | None = 1, stopped: Callable[[], bool] = lambda: False) -> Reference:
    """The reference of one scene at `duration`."""
    steps = reference_steps(duration, max_stable_dt(scene))
    try:
        (fine, contact), (coarse, _) = (_end(scene, duration, n, threads, stopped) for n in (steps, steps // 2))
    except UnstableError:
        return Reference(np.full_like(scene.initial_position, np.nan), math.nan)
    difference = fine - coarse
    error = float(np.linalg.norm(difference, axis=-1).max())
    return Reference(fine + difference / 15, error, contact)


def _end(
    scene: Scene, duration: float, steps: int, threads: int | None, stopped: Callable[[], bool]
) -> tuple[npt.NDArray[np.floating[Any]], bool]:
    stepper = SilentStepper(scene, threads=threads)
    for done in range(0, steps, _STEPS_BETWEEN_LOOKS):
        if stopped():
            raise Stopped
        stepper.advance(min(_STEPS_BETWEEN_LOOKS, steps - done), duration / steps)
    first_contact = stepper._state.core.watched[0]["first_contact"]
    return stepper.positions, not math.isnan(first_contact)


class _Kept:
    """The references that this process has, the last used first to stay; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._references: OrderedDict[str, Reference] = OrderedDict()
        self._making: dict[str, threading.Lock] = {}
        self._bytes = 0

    def get(self, scene: Scene, duration: float, threads: int | None, stopped: Callable[[], bool]) -> Reference:
        key = digest([scene, duration])
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        # Whoever comes second waits for the first instead of doing the same work.
        with making:
            with self._lock:
                if key in self._references:
                    self._references.move_to_end(key)
                    return self._references[key]
            reference = solve(scene, duration, threads, stopped)
            with self._lock:
                self._references[key] = reference
                self._bytes += reference.x.nbytes
                while self._bytes > _BYTES_KEPT and len(self._references) > 1:
                    oldest, dropped = self._references.popitem(last=False)
                    self._making.pop(oldest, None)
                    self._bytes -= dropped.x.nbytes
            return reference


_kept = _Kept()


def references(
    members: Sequence[Member], threads: int | None = 1, stopped: Callable[[], bool] = lambda: False
) -> list[Reference]:
    """The reference of each member; raises Stopped if `stopped` says so."""
    return [_kept.get(m.scene, m.duration, threads, stopped) for m in members]
