"""The solution that the metric "error" compares with: the solution in double with which `cs.reference` checks its own.

Its bound is twice the change by the last halving of the step, plus a unit in the last place. After a contact the motion is
chaotic, and there is no solution to compare with (`incomparable`). It depends on the cloth alone, never on other members
of a sweep. Members that differ in numerics share it, and each process keeps the last references.
"""

from __future__ import annotations

import math
import threading
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..accuracy.in_double import solve_in_double
from ..errors import ContactError, UnstableError
from ..model.scene import Scene
from .grid import digest
from .member import Floats, Member, Outcome, Pause, never

_BYTES_KEPT = 1 << 27


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


def solve(scene: Scene, duration: float, threads: int | None = 1, pause: Pause = never) -> Reference:
    """The reference of one scene at `duration`."""
    try:
        found = solve_in_double(scene, [duration], threads, lambda: pause(0.0))
    except (UnstableError, ContactError):
        return Reference(np.full_like(scene.initial_position, np.nan), math.nan)
    # Both runs may err by rounding, each as much as the other.
    x = found.x[-1]
    return Reference(x, float(2 * found.change[-1] + np.spacing(np.abs(x).max())), found.contact)


class _Kept:
    """The references that this process has, the last used last; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._making: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self._references: dict[str, Reference] = {}

    def get(self, scene: Scene, duration: float, threads: int | None, pause: Pause) -> Reference:
        key = digest([scene, duration])
        with self._lock:
            making = self._making[key]
        with making:  # the second thread waits for the first, which does the same work
            reference = self._references.get(key) or solve(scene, duration, threads, pause)
            with self._lock:
                self._references.pop(key, None)
                self._references[key] = reference
                while len(kept := self._references) > 1 and sum(one.x.nbytes for one in kept.values()) > _BYTES_KEPT:
                    self._making.pop(oldest := next(iter(kept)), None)
                    del kept[oldest]
            return reference


_kept = _Kept()


def references(members: Sequence[Member], threads: int | None = 1, pause: Pause = never) -> list[Reference]:
    """The reference of each member; a Stopped that `pause` raises passes through."""
    return [_kept.get(m.scene, m.duration, threads, pause) for m in members]
