"""Warnings and errors of steps: what an outcome of the core means to a user."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import _core
from ..base.on_demand import later
from ..errors import ContactError, ContactWarning, UnstableError, warn_caller, warn_of_dt, warn_of_growth
from ..methods.bound import limiting_term
from ..model.as_core import in_cells
from ..model.scene import Scene


class Judge:
    """Gives each warning of a simulation once, and raises the error of a failed step, with the state of `core`.

    `scenes` and the guaranteed time steps `max_stable_dt` [s] have one entry for each member, which messages name where the
    state is `batched`.
    """

    def __init__(
        self, core: _core.Simulation, scenes: Sequence[Scene], batched: bool, integrator: str, max_stable_dt: Sequence[float]
    ) -> None:
        self._core, self._scenes, self._batched = core, scenes, batched
        self._integrator, self._max_stable_dt = integrator, max_stable_dt
        self.least_stable_dt = min(*max_stable_dt, sys.float_info.max)  # inf without springs
        self.steps_before = 0  # earlier calls of the run; errors count steps from its start
        self.forget_warnings()

    def forget_warnings(self) -> None:
        """Give each warning again. A flag that is set keeps its warning from the user."""
        self.warned_of_dt = self.warned_of_growth = self.warned_of_pins = self.warned_of_cells = False
        self.warned_of_start = self.warned_of_lifts = False

    def time_step(self, dt: float) -> None:
        """Warn once of a time step above the guarantee of a member that moves."""
        if self.warned_of_dt or dt <= self.least_stable_dt:
            return
        active = [k for k, frozen in enumerate(self._core.frozen) if not frozen]
        limit, member = min(((self._max_stable_dt[k], k) for k in active), default=(dt, 0))
        if dt > limit:
            self.warned_of_dt = True
            term = limiting_term(self._scenes[member], self._integrator).at(dt)
            warn_of_dt(dt, limit, self._integrator, self._named(member), term)

    def outcome(self, outcome: dict[str, Any], dt: float) -> None:
        """Give a warning for each finding of the core, and raise an error for a failed step."""
        if "pinned_inside" in outcome and not self.warned_of_pins:
            self._warn_of_pins(*outcome["pinned_inside"])
        if "large_cell" in outcome and not self.warned_of_cells:
            self._warn_of_cells(*outcome["large_cell"])
        if "start" in outcome and not self.warned_of_start:
            self._warn_of_start(*outcome["start"])
        if "lifted" in outcome and not self.warned_of_lifts:
            self._warn_of_lifts(outcome["lifted"])
        if "grown" in outcome and not self.warned_of_growth:
            self._warn_of_growth(outcome["grown"], dt)
        if "point" in outcome:
            self._raise_error(outcome, dt)

    def _named(self, member: int) -> int | None:
        return member if self._batched else None

    def _state(self, member: int) -> tuple[Any, Any]:
        shape = (len(self._scenes), *self._scenes[0].cloth.shape, 3) if self._batched else (*self._scenes[0].cloth.shape, 3)
        x, v = np.empty(shape), np.empty(shape)
        self._core.store(x, v)
        return (x[member], v[member]) if self._batched else (x, v)

    def _warn_of_pins(self, member: int, point: int) -> None:
        self.warned_of_pins = True
        warn_caller(
            f"a sphere has run into the pinned mass point {divmod(point, self._scenes[member].cloth.columns)}"
            f"{f' of batch member {member}' if self._batched else ''}; a pinned point never "
            "moves, so it, and triangles at it, are inside while the sphere is there",
            ContactWarning,
        )

    def _warn_of_cells(self, member: int, point: int) -> None:
        self.warned_of_cells = True
        cloth = self._scenes[member].cloth
        spheres = [sphere for sphere in self._scenes[member].spheres if in_cells(sphere)]
        least, half = min(sphere.radius for sphere in spheres), math.hypot(*cloth.spacing) / 2
        needed = (
            f"cells with a diagonal below {2 * least:.3g} m, where this cloth has {2 * half:.3g} m at rest"
            if half >= least
            else f"a stretch of its cells below {least / half:.3g}"
        )
        warn_caller(
            f"a cell at the mass point {divmod(point, cloth.columns)}"
            f"{f' of batch member {member}' if self._batched else ''} is larger than the sphere that it touches; "
            f"take more mass points: offset 'cell' needs {needed}, else triangles there may be inside",
            ContactWarning,
        )

    def _warn_of_start(self, member: int, k: int, points: int, deepest: int, depth: float) -> None:
        self.warned_of_start = True
        scene = self._scenes[member]
        warn_caller(
            f"spheres[{k}] starts on the cloth{f' of member {member}' if self._batched else ''}: {points} mass points are "
            f"nearer than they may be, the deepest, {divmod(deepest, scene.cloth.columns)}, by {depth:.3g} m; they are "
            f"pushed out at {scene.spheres[k].push_out_speed:g} m/s at most",
            ContactWarning,
        )

    def _warn_of_lifts(self, member: int) -> None:
        self.warned_of_lifts = True
        made = self._core.watched[member]["lift_work"]
        warn_caller(
            f"cells that grow on a sphere{f' of batch member {member}' if self._batched else ''} have lifted mass points "
            f"against their springs and gravity: this made {made:.3g} J, more than 1 % of the largest kinetic and elastic "
            "energy; take more mass points, or offset 'edge'",
            ContactWarning,
        )

    def _warn_of_growth(self, member: int, dt: float) -> None:
        max_stable_dt = later("stability.limit").max_stable_dt

        self.warned_of_growth = True
        try:
            limit = max_stable_dt(self._scenes[member], self._integrator, *self._state(member))
        except ValueError:  # points too near for a direction; no reason to end the run
            limit = self._max_stable_dt[member]
        warn_of_growth(self._core.time, dt, limit, self._integrator, self._named(member))

    def _raise_error(self, outcome: dict[str, Any], dt: float) -> None:
        member = outcome["member"]
        scene = self._scenes[member]
        x, v = self._state(member)
        point = outcome["point"]
        found: dict[str, Any] = {
            "step": self.steps_before + outcome["step"],
            "time": outcome["time"],
            "point": None if scene.cloth.pinned.flat[point] else divmod(point, scene.cloth.columns),
            "x": x,
            "v": v,
            "member": self._named(member),
        }
        if outcome["trapped"]:
            raise ContactError(**found)
        term = limiting_term(scene, self._integrator)
        words = term.at(dt) if dt > term.max_stable_dt else str(term)
        raise UnstableError(**found, dt=dt, max_stable_dt=self._max_stable_dt[member], term=words)
