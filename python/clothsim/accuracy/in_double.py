"""The solution in double: steps of dop853, halved until only rounding changes.

`cs.reference` compares its extrapolation in long double with this solution. A sweep, which needs
solutions by the thousand, measures its members by this solution alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base import Floats
from ..engine.stepper import SilentStepper
from ..methods.bound import stable_dt
from ..model.scene import Scene
from ..run.trajectory import PAUSE

# The first steps are this part of RK4's stable step, well below the stable step of dop853.
_COARSEST = 0.5
_FEWEST_STEPS = 8
_MOST_HALVINGS = 8
_ORDER = 8
_EVALUATIONS_PER_STEP = 12
_STEPS_BETWEEN_PAUSES = 512


@dataclass(frozen=True)
class InDouble:
    """Positions at some times, and their error."""

    x: Floats  # [m], shape (times, rows, columns, 3)
    change: Floats  # by the last halving [m]: the largest distance of a mass point, shape (times,)
    force_evaluations: int  # of all runs together
    contact: bool  # whether a sphere has responded in one of the runs


def solve_in_double(scene: Scene, times: list[float], threads: int | None) -> InDouble:
    """Positions at `times` [s after the start], increasing, by the kernels.

    The step is halved until a halving changes no more than rounding does. No tolerance has to be chosen for a scene.
    Errors are those of `Stepper.advance`.
    """
    largest = min(_COARSEST * stable_dt(scene), times[-1] / _FEWEST_STEPS)
    positions, steps, contact = _run(scene, times, largest, threads)
    change, changes = math.inf, np.full(len(times), math.inf)
    for _ in range(_MOST_HALVINGS):
        largest /= 2
        finer, more, contact_too = _run(scene, times, largest, threads)
        before, change = change, float(abs(finer - positions).max())
        changes = np.linalg.norm(finer - positions, axis=-1).max(axis=(-2, -1))
        positions, steps, contact = finer, steps + more, contact or contact_too
        if change >= before / 2 ** (_ORDER / 2):  # truncation would have made it 256 times smaller
            break
    return InDouble(positions, changes, _EVALUATIONS_PER_STEP * steps, contact)


def _run(scene: Scene, times: list[float], largest: float, threads: int | None) -> tuple[Floats, int, bool]:
    """One run with steps of at most `largest`: positions at `times`, number of steps, and whether a sphere
    responded.
    """
    stepper = SilentStepper(scene, integrator="dop853", threads=threads)
    positions, steps, pause = [], 0, PAUSE.get()
    for begin, end in zip([0.0, *times[:-1]], times, strict=True):
        count = math.ceil((end - begin) / largest)
        for done in range(0, count, _STEPS_BETWEEN_PAUSES):
            if pause is not None:
                pause()
            stepper.advance(min(_STEPS_BETWEEN_PAUSES, count - done), (end - begin) / count)
        positions.append(stepper.positions)
        steps += count
    first_contact = stepper._state.core.watched[0]["first_contact"]
    return np.array(positions), steps, not math.isnan(first_contact)
