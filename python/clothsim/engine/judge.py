"""Warnings and errors of steps: what an outcome of the core means to a user."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .. import _core
from ..errors import ContactError, ContactWarning, StabilityWarning, UnstableError, warn_caller
from ..methods.bound import limiting_term
from ..model.scene import Scene
from ..model.sphere import kind_name


class Judge:
    """Gives each warning of a simulation once, and raises the error of a failed step, with the
    state of `core`.

    `scenes` and the guaranteed time steps `max_stable_dt` [s] have one entry for each member, which
    messages name where the state is `batched`.
    """

    def __init__(
        self,
        core: _core.Simulation,
        scenes: Sequence[Scene],
        batched: bool,
        integrator: str,
        max_stable_dt: Sequence[float],
    ) -> None:
        self._core, self._scenes, self._batched = core, scenes, batched
        self._integrator, self._max_stable_dt = integrator, max_stable_dt
        self.least_stable_dt = min(*max_stable_dt, sys.float_info.max)  # inf without springs
        self.steps_before = 0  # earlier calls of the run; errors count steps from its start
        self.given: set[str] = set()  # warnings that are given, or kept from the user

    def time_step(self, dt: float) -> None:
        """Warn once of a time step above the guarantee of a member that moves."""
        if "dt" in self.given or dt <= self.least_stable_dt:
            return
        active = [k for k, frozen in enumerate(self._core.frozen) if not frozen]
        limit, member = min(((self._max_stable_dt[k], k) for k in active), default=(dt, 0))
        if dt > limit:
            self.given.add("dt")
            which = f"batch member {member}" if self._batched else "this scene"
            stable = f"guaranteed to be stable for {which}"
            text = f"no dt is {stable} with {self._integrator}"
            if limit:
                text = (
                    f"dt = {dt:g} s is above {limit:.3g} s, up to which {self._integrator} is "
                    f"{stable}"
                )
            warn_caller(
                f"{text}; {limiting_term(self._scenes[member], self._integrator)}", StabilityWarning
            )

    def outcome(self, outcome: dict[str, Any], dt: float) -> None:
        """Give a warning for each finding of the core, and raise an error for a failed step."""
        contacts: dict[str, Callable[[Any], str]] = {
            "pinned_inside": self._pins_text,
            "large_cell": self._cells_text,
            "start": self._start_text,
            "lifted": self._lifts_text,
        }
        for name, text in contacts.items():
            if name in outcome and name not in self.given:
                self.given.add(name)
                warn_caller(text(outcome[name]), ContactWarning)
        if "grown" in outcome and "grown" not in self.given:
            self._warn_of_growth(outcome["grown"], dt)
        if "point" in outcome:
            self._raise_error(outcome, dt)

    def _named(self, member: int) -> int | None:
        return member if self._batched else None

    def _of(self, member: int) -> str:
        return f" of batch member {member}" if self._batched else ""

    def _state(self, member: int) -> tuple[Any, Any]:
        shape = (*self._scenes[0].cloth.shape, 3)
        x, v = np.empty((2, len(self._scenes), *shape))
        self._core.store(*((x, v) if self._batched else (x[0], v[0])))
        return x[member], v[member]

    def _pins_text(self, found: tuple[int, int]) -> str:
        member, point = found
        return (
            f"a {kind_name(self._scenes[member].spheres)} has run into the pinned mass point "
            f"{divmod(point, self._scenes[member].cloth.columns)}"
            f"{self._of(member)}; a pinned point never moves, so it, and triangles at it, "
            "are inside while it is there"
        )

    def _cells_text(self, found: tuple[int, int]) -> str:
        member, point = found
        cloth = self._scenes[member].cloth
        least = min(sphere.radius for sphere in self._scenes[member].spheres if sphere.in_cells)
        half = math.hypot(*cloth.spacing) / 2
        needed = (
            f"cells with a diagonal below {2 * least:.3g} m, where this cloth has "
            f"{2 * half:.3g} m at rest"
            if half >= least
            else f"a stretch of its cells below {least / half:.3g}"
        )
        return (
            f"a cell at the mass point {divmod(point, cloth.columns)}{self._of(member)} is larger "
            "than the sphere that it touches; take more mass points: offset 'cell' needs "
            f"{needed}, else triangles there may be inside"
        )

    def _start_text(self, found: tuple[int, int, int, int, float]) -> str:
        member, k, points, deepest, depth = found
        scene = self._scenes[member]
        kind = kind_name([scene.spheres[k]])
        return (
            f"the {kind} spheres[{k}] starts on the cloth{self._of(member)}: {points} mass points "
            f"are nearer than they may be, the deepest, {divmod(deepest, scene.cloth.columns)}, by "
            f"{depth:.3g} m; they are pushed out at {scene.spheres[k].push_out_speed:g} m/s at "
            "most"
        )

    def _lifts_text(self, member: int) -> str:
        return (
            f"cells that grow on a sphere{self._of(member)} have lifted mass points against their "
            f"springs and gravity: this made {self._core.watched[member]['lift_work']:.3g} J, "
            "more than 1 % of the largest kinetic and elastic energy; take more mass points, or "
            "offset 'edge'"
        )

    def _warn_of_growth(self, member: int, dt: float) -> None:
        from ..stability.limit import max_stable_dt

        self.given.add("grown")
        try:
            limit = max_stable_dt(self._scenes[member], self._integrator, *self._state(member))
        except ValueError:  # points too near for a direction; no reason to end the run
            limit = self._max_stable_dt[member]
        advice = (
            "take a dt below it" if limit < dt else "states before it bear less; take a smaller dt"
        )
        reach = (
            f"is stable at that state up to {limit:.3g} s: {advice}"
            if limit
            else "is stable there at no time step"
        )
        warn_caller(
            f"energy{self._of(member)} grows out of nothing: at t = {self._core.time:g} s "
            "more than half of the kinetic and "
            f"elastic energy was made by the time step dt = {dt:g} s; {self._integrator} {reach}",
            StabilityWarning,
        )

    def _raise_error(self, outcome: dict[str, Any], dt: float) -> None:
        member, point = outcome["member"], outcome["point"]
        scene = self._scenes[member]
        x, v = self._state(member)
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
        term = str(limiting_term(scene, self._integrator))
        raise UnstableError(**found, dt=dt, max_stable_dt=self._max_stable_dt[member], term=term)
