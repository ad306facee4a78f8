"""One cloth of a sweep: its scene, the settings of its run and the record of its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import check
from ..engine.force import checked_force
from ..engine.options import Options
from ..methods.bound import stable_dt, usable_dt
from ..methods.integrators import integrator_name
from ..model.fields import RUN, change_scene
from ..model.scene import Scene
from ..run.simulate import checked_tolerances
from ..run.trajectory import checked_every

PENDING, DONE, UNSTABLE, FAILED = range(4)
STATUS = ("pending", "done", "unstable", "failed")
"""What a member's status, the index into this, means."""


@dataclass(frozen=True)
class SweepOptions:
    """The arguments of `sweep` on which results depend. Members share those not swept."""

    duration: float = 1.0
    dt: float | None = None
    integrator: str | None = None
    precision: str = "double"
    kernel: str = "auto"
    every: Any = None  # checked: steps (int), seconds (float) or None
    rtol: float | None = None
    atol: float | None = None
    force: Any = None

    def __post_init__(self) -> None:
        self.__dict__.update(
            duration=check.number("duration", self.duration, minimum=0, exclusive=True),
            dt=None if self.dt is None else check.number("dt", self.dt, minimum=0, exclusive=True),
            integrator=None
            if self.integrator is None
            else integrator_name(self.integrator, "auto"),
            every=checked_every(self.every),
            force=checked_force(self.force),
        )


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


class Maker:
    """Makes members of a scene and swept values. Those with equal run values share `settings`."""

    def __init__(self, base: Scene, options: SweepOptions) -> None:
        self._base, self._options, self._known = base, options, dict[str, dict[str, Any]]()
        shared = "initial_position", "initial_velocity", "driven_pins", "core_spheres", "has_layers"
        for name in (*shared, "core_forces"):
            getattr(base, name)  # which caches it for all members
        _ = base.cloth.core  # with the arrays that it is made of

    def __call__(self, index: int, values: Mapping[str, Any]) -> Member:
        """The member with these values; a refused value raises the error of its argument."""
        run = (
            {}
            if values.keys().isdisjoint(RUN)
            else {name: values[name] for name in RUN if name in values}
        )
        scene = change_scene(
            self._base,
            {name: values[name] for name in values if name not in run} if run else values,
        )
        settings = self._known.get(key := repr(run))
        if settings is None:
            settings = self._known[key] = self._settings(run)
        integrator, dt = settings["integrator"], settings["dt"]
        integrator = "rk4" if integrator in ("auto", None) else integrator
        limit = usable_dt(scene, integrator) if dt is None else stable_dt(scene, integrator)
        return Member(index, scene, settings, dt, limit)

    def _settings(self, run: Mapping[str, Any]) -> dict[str, Any]:
        """The checked arguments of `simulate` of members with the swept values `run`; what is not
        given is left to `simulate`.
        """
        given = {name: run.get(name, getattr(self._options, name)) for name in (*RUN, "force")}
        if given["integrator"] is None and given["dt"] is not None:
            given["integrator"] = "rk4"
        name = given["integrator"]
        if name is not None:
            name = integrator_name(name, "auto", fixed=given["dt"] is not None)
            given["integrator"] = name
        method = "rk4" if name in ("auto", None) else name
        Options(method, given["precision"], None, given["kernel"])
        duration = given["duration"] = check.number(
            "duration", given["duration"], minimum=0, exclusive=True
        )
        tolerances = given["rtol"], given["atol"]
        if name == "auto" or any(one is not None for one in tolerances):
            given["rtol"], given["atol"] = checked_tolerances(given["dt"], *tolerances)
        elif given["dt"] is not None:
            given["dt"] = check.number("dt", given["dt"], minimum=0, exclusive=True)
            check.step_count(duration, given["dt"])
        return given


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
