"""One cloth of a sweep: its scene, the settings of its run and the record of its result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import Floats, check
from ..engine.options import Options
from ..methods.bound import guaranteed_dt, stable_dt, usable_dt
from ..methods.integrators import integrator_name
from ..model.fields import RUN, change_scene
from ..model.scene import Scene
from ..run.frames import checked_every
from ..run.simulate import checked_tolerances

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
        self.__dict__.update(
            duration=check.number("duration", self.duration, minimum=0, exclusive=True),
            dt=None if self.dt is None else check.number("dt", self.dt, minimum=0, exclusive=True),
            integrator=None if self.integrator is None else integrator_name(self.integrator, "auto"),
            every=checked_every(self.every),
            frames=check.boolean("frames", self.frames),
        )

    @property
    def needs(self) -> frozenset[str]:
        """The data that the metrics and the store need; see `Metric`."""
        return frozenset(need for metric in self.metrics for need in metric.needs) | ({"frames"} if self.frames else set())


@dataclass(frozen=True)
class Settings:
    """How members are run. `arguments` of `simulate` have the tolerances too, where these choose the step (`controlled`)."""

    duration: float
    dt: float | None  # None: by the cloth
    controlled: bool
    numerics: Mapping[str, Any]  # integrator, precision and kernel
    arguments: Mapping[str, Any]

    @classmethod
    def of(cls, options: SweepOptions, run: Mapping[str, Any]) -> Settings:
        """The settings of the members with the swept values `run`; a refused value raises the error of its argument."""
        given = {name: run.get(name, getattr(options, name)) for name in RUN}
        dt, rtol, atol = given["dt"], given["rtol"], given["atol"]
        if given["integrator"] is None:
            given["integrator"] = "rk4" if rtol is None and atol is None else "auto"
        name = integrator_name(given["integrator"], "auto")
        numerics = {"integrator": name, "precision": given["precision"], "kernel": given["kernel"]}
        Options("rk4" if name == "auto" else name, given["precision"], None, given["kernel"])
        duration = check.number("duration", given["duration"], minimum=0, exclusive=True)
        if isinstance(options.every, float):
            check.frame_count("every", options.every, duration / options.every)
        if name == "auto" or rtol is not None or atol is not None:
            rtol, atol = checked_tolerances(dt, rtol, atol)
            return cls(duration, None, True, numerics, {**numerics, "rtol": rtol, "atol": atol})
        if dt is not None:
            dt = check.number("dt", dt, minimum=0, exclusive=True)
            check.step_count(duration, dt)
        return cls(duration, dt, False, numerics, numerics)


@dataclass(frozen=True)
class Member:
    """A cloth to run, with its index in the sweep, its time step [s] (NaN with error control) and its guaranteed step
    [s]."""

    index: int
    scene: Scene
    settings: Settings
    dt: float
    max_stable_dt: float

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of `simulate`."""
        return {**self.settings.arguments, **({} if self.settings.controlled else {"dt": self.dt})}


class Maker:
    """Makes members of a scene and swept values. Members with equal values of the run share their `Settings`."""

    def __init__(self, base: Scene, options: SweepOptions) -> None:
        self._base, self._options, self._known = base, options, dict[str, Settings]()
        for kept in ("initial_position", "initial_velocity", "driven_pins", "core_spheres"):  # which members share
            getattr(base, kept)
        _ = base.cloth.core  # with the arrays that it is made of

    def __call__(self, index: int, values: Mapping[str, Any]) -> Member:
        """The member with these values; a refused value raises the error of its argument."""
        run = {name: values[name] for name in RUN if name in values}
        scene = change_scene(self._base, {name: values[name] for name in values if name not in run} if run else values)
        settings = self._known.get(key := repr(run))
        if settings is None:
            settings = self._known[key] = Settings.of(self._options, run)
        cloth, integrator, dt = scene.cloth.core, settings.numerics["integrator"], settings.dt
        integrator = "rk4" if integrator == "auto" else integrator
        limit = usable_dt(cloth, integrator) if dt is None else guaranteed_dt(cloth, integrator)
        if settings.controlled:
            dt = math.nan
        elif dt is None:
            # A method without a limit of its own takes what follows the motion as well.
            dt = min(_SAFETY * (limit if math.isfinite(limit) else stable_dt(scene)), settings.duration)
            check.step_count(settings.duration, dt)
        return Member(index, scene, settings, dt, limit)


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
