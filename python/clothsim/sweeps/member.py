"""One cloth of a sweep: its scene, its options and the record of its run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import Floats, check
from ..engine.options import Options
from ..methods.bound import usable_dt
from ..methods.data import integrator_name
from ..model.as_core import core_cloth
from ..model.fields import change_scene, split
from ..model.scene import Scene
from ..run.frames import checked_every
from ..run.simulate import checked_tolerances
from ..stability.limit import max_stable_dt

_SAFETY = 0.5  # part of the guaranteed stable time step that is taken where none is given

PENDING, DONE, UNSTABLE, FAILED = range(4)
STATUS = ("pending", "done", "unstable", "failed")
"""What a member's status, the index into this, means."""


@dataclass(frozen=True)
class SweepOptions:
    """The arguments of `sweep` on which results depend. All members share them, unless they are swept."""

    duration: float = 1.0
    dt: float | None = None
    integrator: str | None = None
    precision: str = "double"
    kernel: str = "auto"
    every: Any = None  # checked: steps (int), seconds (float) or None
    frames: bool = False
    metrics: tuple[Any, ...] = ()
    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        checked = {
            "duration": check.number("duration", self.duration, minimum=0, exclusive=True),
            "dt": None if self.dt is None else check.number("dt", self.dt, minimum=0, exclusive=True),
            "integrator": None if self.integrator is None else integrator_name(self.integrator, "auto"),
            "every": checked_every(self.every),
            "frames": check.boolean("frames", self.frames),
        }
        self.__dict__.update(checked)

    @property
    def needs(self) -> frozenset[str]:
        """The data that the metrics and the store need; see `Metric`."""
        return frozenset(need for metric in self.metrics for need in metric.needs) | ({"frames"} if self.frames else set())


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
    rtol: float | None = None
    atol: float | None = None

    @classmethod
    def make(cls, index: int, base: Scene, values: Mapping[str, Any], options: SweepOptions) -> Member:
        """Make the member with these swept values; a refused value raises the error of its argument."""
        of_scene, run = split(values)
        scene = change_scene(base, of_scene)
        numerics = {name: run.get(name, getattr(options, name)) for name in ("integrator", "precision", "kernel")}
        dt, rtol, atol = (run.get(name, getattr(options, name)) for name in ("dt", "rtol", "atol"))
        if numerics["integrator"] is None:
            numerics["integrator"] = "rk4" if rtol is None and atol is None else "auto"
        numerics["integrator"] = integrator_name(numerics["integrator"], "auto")
        automatic = numerics["integrator"] == "auto"
        named = "rk4" if automatic else numerics["integrator"]
        Options(named, numerics["precision"], None, numerics["kernel"])
        duration = check.number("duration", run.get("duration", options.duration), minimum=0, exclusive=True)
        if isinstance(options.every, float):
            check.frame_count("every", options.every, duration / options.every)
        limit = float(max_stable_dt(scene, named) if dt is not None else usable_dt(core_cloth(scene.cloth), named))
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
        return {"integrator": self.integrator, "precision": self.precision, "kernel": self.kernel}

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of `simulate`: those of `Stepper`, and those that choose its steps."""
        return {**self.numerics, **({"rtol": self.rtol, "atol": self.atol} if self.controlled else {"dt": self.dt})}

    @property
    def controlled(self) -> bool:
        """Whether tolerances choose the step, of this member alone."""
        return math.isnan(self.dt)

    @property
    def batch_key(self) -> tuple[Any, ...]:
        """A key that is equal for members that one call steps. A member that may diverge has a key of its own."""
        alone = None if self.dt <= self.max_stable_dt else self.index
        return (self.scene.cloth.shape, self.duration, self.dt, *self.numerics.values(), alone)


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
