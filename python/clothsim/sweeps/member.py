"""One cloth of a sweep: its scene, the settings of its run and the record of its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import check
from ..engine.force import check_force
from ..engine.options import Options
from ..methods.bound import stable_dt, stable_dt_or_error
from ..methods.integrators import check_integrator_name
from ..model.fields import RUN, change_scene
from ..model.scene import Scene
from ..run.frames import checked_frame_interval
from ..run.simulate import checked_tolerances

PENDING, DONE, UNSTABLE, FAILED = range(4)
STATUS = ("pending", "done", "unstable", "failed")
"""Meanings of a member's status, which is an index into these."""


@dataclass(frozen=True)
class SweepOptions:
    """The arguments of `sweep` on which results depend; members share those that are not swept."""

    duration: float = 1.0
    dt: float | None = None
    integrator: str | None = None
    precision: str = "double"
    kernel: str = "auto"
    every: Any = None  # steps (int), seconds (float) or None, once it is checked
    rtol: float | None = None
    atol: float | None = None
    force: Any = None

    def __post_init__(self) -> None:
        values = self.__dict__  # The class is frozen to its users.
        values["duration"] = check.number("duration", self.duration, minimum=0, exclusive=True)
        if self.dt is not None:
            values["dt"] = check.number("dt", self.dt, minimum=0, exclusive=True)
        if self.integrator is not None:
            values["integrator"] = check_integrator_name(self.integrator, "auto")
        values["every"] = checked_frame_interval(self.every)
        values["force"] = check_force(self.force)


@dataclass(frozen=True)
class Member:
    """A cloth to run, with its index in the sweep, and its guaranteed stable time step [s].

    `settings` are arguments of `simulate`: time steps of `dt` [s], or a tolerance, where `dt` is
    None.
    """

    index: int
    scene: Scene
    settings: Mapping[str, Any]
    dt: float | None
    max_stable_dt: float


class MemberMaker:
    """A maker of members of a scene and swept values.

    Members with equal run values share their `settings`.
    """

    def __init__(self, base: Scene, options: SweepOptions) -> None:
        self._base = base
        self._options = options
        self._settings_of: dict[str, dict[str, Any]] = {}
        # The scene caches these for all members.
        for name in (
            *("initial_position", "initial_velocity", "driven_pins"),
            *("core_spheres", "core_forces", "has_layers"),
        ):
            getattr(base, name)
        _ = base.cloth.core

    def __call__(self, index: int, values: Mapping[str, Any]) -> Member:
        """Make the member with these values; a wrong value raises the error of its argument."""
        run = {}
        changes = values
        if not values.keys().isdisjoint(RUN):
            run = {name: values[name] for name in RUN if name in values}
            changes = {name: values[name] for name in values if name not in run}
        scene = change_scene(self._base, changes)
        key = repr(run)
        settings = self._settings_of.get(key)
        if settings is None:
            settings = self._make_settings(run)
            self._settings_of[key] = settings
        dt = settings["dt"]
        integrator = settings["integrator"]
        if integrator in ("auto", None):
            integrator = "rk4"
        limit = (
            stable_dt_or_error(scene, integrator) if dt is None else stable_dt(scene, integrator)
        )
        return Member(index, scene, settings, dt, limit)

    def _make_settings(self, run: Mapping[str, Any]) -> dict[str, Any]:
        """Check the arguments of `simulate` of members with the swept values `run`.

        A choice that is None is left to `simulate`.
        """
        settings = {name: run.get(name, getattr(self._options, name)) for name in (*RUN, "force")}
        dt = settings["dt"]
        if settings["integrator"] is None and dt is not None:
            settings["integrator"] = "rk4"
        name = settings["integrator"]
        if name is not None:
            name = check_integrator_name(name, "auto", fixed=dt is not None)
            settings["integrator"] = name
        method = "rk4" if name in ("auto", None) else name
        Options(method, settings["precision"], None, settings["kernel"])
        duration = check.number("duration", settings["duration"], minimum=0, exclusive=True)
        settings["duration"] = duration
        tolerances = (settings["rtol"], settings["atol"])
        if name == "auto" or any(tolerance is not None for tolerance in tolerances):
            settings["rtol"], settings["atol"] = checked_tolerances(dt, *tolerances)
        elif dt is not None:
            settings["dt"] = check.number("dt", dt, minimum=0, exclusive=True)
            check.check_step_count(duration, settings["dt"])
        return settings


@dataclass
class MemberRecord:
    """Record of a member: plain values, small enough to travel between machines."""

    index: int
    status: int
    values: dict[str, Any] = field(default_factory=dict)
    max_stable_dt: float = np.nan
    unstable_step: int = -1
    unstable_time: float = np.nan
    message: str = ""
