"""A run of a scene as data: the `Job` that asks for it, and the `Trajectory` that it becomes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from ..base import Floats
from ..engine.options import Options
from ..engine.snapshot import Snapshot
from ..engine.state import State
from ..model.scene import Scene
from ..typing import Force
from .frames import NEGLIGIBLE, Frames

# The tolerance of a step [m], the weight of velocities in it [1/s] and the state of the core's
# controller.
ControlValues = tuple[float, float, tuple[float, float, bool]]


@dataclass(frozen=True)
class Continuation:
    """The settings of a run, for its continuation: plain data, but for `frames`."""

    start: float  # time of the start [s]
    seconds: float = 0.0  # duration of the run so far
    steps: int = 0  # since the start
    dt: float | None = None  # time step [s]; None with error control
    frames: Frames = Frames()
    control: ControlValues | None = None  # with error control
    forced: bool = False  # by a function, which is no data


@dataclass(frozen=True)
class Job:
    """What one run computes: with fixed steps of `dt`, or else with error control.

    `own_step`: the step is not the caller's, so no warning names it, and no snapshot of a batch is
    kept. `shown`: the callback and the progress bar follow the run.
    """

    scenes: list[Scene]
    batched: bool  # whether a sequence of scenes was given
    duration: float  # [s]
    options: Options
    start: float = 0.0  # time of the initial state [s]
    frames: Frames = Frames()
    force: Force | list[Force] | None = None
    dt: float | None = None  # [s]
    own_step: bool = False
    longest: float = math.inf  # own steps between two kinks are equal parts of steps of this [s]
    shown: bool = True
    tolerance: float = math.nan  # of a step [m]
    grid: tuple[float, ...] = ()  # prescribed ends of steps
    resumed: tuple[Snapshot, Continuation] | None = None  # the end of the run to continue

    @property
    def scene(self) -> Scene:
        return self.scenes[0]


@dataclass(kw_only=True)
class Trajectory:
    """A run of a scene, or its part so far: frames, cost, extremes over all states, local error."""

    scene: Scene
    options: Options
    t: list[float]
    x: Floats
    v: Floats
    steps: int
    rejected: int
    evaluations: int
    wall_time: float  # of stepping [s]
    step: float  # fixed: the time step, adaptive: the mean one [s]
    watched: Mapping[str, Any]  # extremes over the states, see Watched in the core
    state: State
    saved: (
        dict[str, Any] | None
    )  # the fields of the core for a member of a batch, which `state` steps
    continuation: Continuation
    tolerance: float = math.nan  # of a step [m], with error control
    ends: list[float] = field(default_factory=list)  # of its steps
    kinks: list[int] = field(default_factory=list)  # steps before each kink of a motion
    local_error: float = 0.0  # sum of the method's own estimates of the steps' errors [m]

    @property
    def has_contacts(self) -> bool:
        return bool(self.watched["responded"])

    def refined_step_ends(self, ratio: float) -> tuple[float, ...]:
        """Return the ends of a grid with `ratio` times as many steps between two kinks.

        Its times are interpolated linearly.
        """
        ends = [self.t[0], *self.ends]
        finer = []
        for first, last in pairwise([0, *self.kinks, len(self.ends)]):
            count = last - first
            numbers = np.linspace(
                0, count, max(count + 1, math.ceil(ratio * count - NEGLIGIBLE)) + 1
            )[1:]
            finer += np.interp(numbers, np.arange(count + 1), ends[first : last + 1]).tolist()
        return tuple(finer)
