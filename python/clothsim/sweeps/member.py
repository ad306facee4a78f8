"""One cloth of a sweep: its scene, its settings and its result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import check
from ..engine.options import Options
from ..errors import ContactError, UnstableError
from ..methods.integration import integrator_name
from ..model.scene import Scene
from ..run.account import of_nothing, report
from ..run.fixed_steps import RunOptions, Solution, checked_tolerances
from ..run.result import Run
from ..stability.limit import max_stable_dt
from .fields import change_scene, split
from .grid import Grid

Floats = npt.NDArray[np.float64]

_SAFETY = 0.5  # part of the guaranteed stable time step that is taken where none is given

# Of a run with error control and its companion, beside one of RK4 at its guaranteed step; that of a
# large tolerance is less, of a small one more.
_COST_OF_CONTROL = 3.0

_POINTS_KEPT = 1 << 21  # mass points in all members that are kept; some 10 bytes each

PENDING, DONE, UNSTABLE, FAILED = range(4)
STATUS = ("pending", "done", "unstable", "failed")
"""What a member's status, the index into this, means."""


@dataclass(frozen=True)
class Settings:
    """Settings of all members, unless they are swept; see `sweep`."""

    duration: float
    dt: float | None
    integrator: str | None
    precision: str
    kernel: str
    strict: bool
    every: int | float | None
    frames: bool
    sampling: int
    metrics: tuple[Any, ...]
    rtol: float | None = None
    atol: float | None = None


@dataclass(frozen=True)
class Member:
    """A cloth to run, with its index in the sweep."""

    index: int
    scene: Scene
    duration: float
    dt: float  # NaN with error control
    max_stable_dt: float
    integrator: str
    precision: str
    kernel: str
    strict: bool
    rtol: float | None = None
    atol: float | None = None

    @classmethod
    def make(cls, index: int, base: Scene, values: Mapping[str, Any], settings: Settings) -> Member:
        """Make the member with these swept values; a refused value raises the error of its argument."""
        of_scene, run = split(values)
        scene = change_scene(base, of_scene)
        numerics = {name: run.get(name, getattr(settings, name)) for name in ("integrator", "precision", "kernel", "strict")}
        dt, rtol, atol = (run.get(name, getattr(settings, name)) for name in ("dt", "rtol", "atol"))
        if numerics["integrator"] is None:
            numerics["integrator"] = "rk4" if rtol is None and atol is None else "auto"
        numerics["integrator"] = integrator_name(numerics["integrator"], "auto")
        automatic = numerics["integrator"] == "auto"
        named = "rk4" if automatic else numerics["integrator"]
        Options(named, numerics["precision"], None, numerics["kernel"], numerics["strict"])
        duration = check.number("duration", run.get("duration", settings.duration), minimum=0, exclusive=True)
        if isinstance(settings.every, float):
            check.frame_count(duration, settings.every)
        limit = float(max_stable_dt(scene, named))
        if automatic or rtol is not None or atol is not None:
            rtol, atol = checked_tolerances(dt, rtol, atol)
            return cls(index, scene, duration, math.nan, limit, **numerics, rtol=rtol, atol=atol)
        if dt is None:
            # A method without a limit of its own takes what follows the motion as well.
            follows = limit if math.isfinite(limit) else float(max_stable_dt(scene))
            dt = min(_SAFETY * follows, duration)
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        check.step_count(duration, dt)
        return cls(index, scene, duration, dt, limit, **numerics)

    @property
    def numerics(self) -> dict[str, Any]:
        """Arguments of `Stepper`."""
        return {"integrator": self.integrator, "precision": self.precision, "kernel": self.kernel, "strict": self.strict}

    @property
    def controlled(self) -> bool:
        """Whether tolerances choose the step; see `run_controlled`."""
        return math.isnan(self.dt)

    @property
    def likely_unstable(self) -> bool:
        return self.dt > self.max_stable_dt

    @property
    def expected_steps(self) -> float:
        """Approximate number of steps. For a member with error control: steps of RK4 with equal cost."""
        if not self.controlled:
            return self.duration / self.dt
        return max(4.0, _COST_OF_CONTROL * self.duration / self.max_stable_dt)

    @property
    def batch_key(self) -> tuple[Any, ...]:
        """A key that is equal for members that one call can step. A member that may diverge has a key of its own."""
        alone = self.index if self.likely_unstable else None
        shared = (self.scene.cloth.shape, self.duration, self.dt, *self.numerics.values())
        return (*shared, alone)


class Members:
    """The members of a sweep, made by index. Some are kept for their next use.

    A member is made for the check of the sweep, for its cost, and for its run. In one process,
    small members are kept between these.
    """

    def __init__(self, scene: Scene, grid: Grid, settings: Settings) -> None:
        self.scene, self.grid, self.settings = scene, grid, settings
        self._kept: dict[int, Member] = {}
        self._room = _POINTS_KEPT

    def make(self, index: int) -> Member:
        """Make the member, and keep it if there is room; a refused value raises the error of its argument."""
        if index in self._kept:
            return self._kept[index]
        member = Member.make(index, self.scene, self.grid.member(index), self.settings)
        points = math.prod(member.scene.cloth.shape)
        if points <= self._room:
            self._room -= points
            self._kept[index] = member
        return member

    def take(self, index: int) -> Member | None:
        """The member if it is kept; no longer kept then."""
        member = self._kept.pop(index, None)
        if member is not None:
            self._room += math.prod(member.scene.cloth.shape)
        return member


@dataclass
class Outcome:
    """Result of a member's run, the argument of every metric."""

    member: Member
    steps: int = 0
    seconds: float = 0.0  # its share of the time in which its batch was stepped
    error: UnstableError | ContactError | None = None
    t: list[float] = field(default_factory=list)
    x: list[Floats] = field(default_factory=list)
    v: list[Floats] = field(default_factory=list)
    watched: Mapping[str, Any] = field(default_factory=dict)  # see `Solution`
    evaluations: int = 0
    state: Any = None  # that stepped it
    reference: Any = None
    itself: Run | None = None  # of a member with error control

    @property
    def scene(self) -> Scene:
        return self.member.scene

    @property
    def contact(self) -> bool:
        """Whether a sphere has responded to a mass point."""
        return not math.isnan(self.watched.get("first_contact", math.nan))

    def run(self) -> Run:
        """The result as a run of `simulate`, for metrics that are functions of a run."""
        if self.itself is not None:
            return self.itself
        member = self.member
        evaluations = 4 * self.steps if member.integrator == "rk4" else self.evaluations
        solution = Solution(
            RunOptions(**member.numerics, threads=self.state.threads),
            self.t,
            np.array(self.x),
            np.array(self.v),
            self.steps,
            0,
            evaluations,
            self.seconds,
            self.watched,
            member.dt,
            self.state,
        )
        facts = report(self.scene, solution, of_nothing())
        return Run(self.scene, np.array(self.t), solution.x, solution.v, facts)


@dataclass
class Record:
    """Record of a member: plain values, small enough to travel between machines."""

    index: int
    status: int
    values: dict[str, Any] = field(default_factory=dict)
    max_stable_dt: float = np.nan
    unstable_step: int = -1
    unstable_time: float = np.nan
    message: str = ""
    frames: tuple[Floats, Floats] | None = None
