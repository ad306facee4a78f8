"""Warnings and errors of steps: what an outcome of the core means to a user."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .. import _core
from ..base.services import service
from ..errors import ContactError, ContactWarning, StabilityWarning, UnstableError, warn_caller
from ..methods.bound import limit_in_layer, limiting_term
from ..model.scene import Scene
from ..model.sphere import kind_name
from ..typing import Force
from .options import Options, kept_plan


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
        forces: Sequence[Force | None],
    ) -> None:
        self._core, self._scenes, self._batched = core, scenes, batched
        self._integrator, self._max_stable_dt = integrator, max_stable_dt
        self._forces = forces
        self.least_stable_dt = min(*max_stable_dt, sys.float_info.max)  # inf without springs
        self._fixed = True  # the steps are the caller's, not those of error control
        self.steps_before = 0  # earlier calls of the run; errors count steps from its start
        self.given: set[str] = set()  # warnings that are given, or kept from the user

    def own_steps(self) -> None:
        """Keep warnings of the time step from the user: error control chooses the steps."""
        self._fixed = False
        self.given |= {"dt", "grown", "stiff"}

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
            "below": self._below_text,
        }
        for name, text in contacts.items():
            if name in outcome and name not in self.given:
                self.given.add(name)
                warn_caller(text(outcome[name]), ContactWarning)
        if "stiff" in outcome and "stiff" not in self.given:
            self.given.add("stiff")
            warn_caller(self._stiff_text(outcome["stiff"], dt), StabilityWarning)
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
            "the pinned mass point "
            f"{divmod(point, self._scenes[member].cloth.columns)}{self._of(member)} is inside a "
            f"{kind_name(self._scenes[member].spheres)}; no contact moves it, so it, and triangles "
            "at it, are inside while it is there"
        )

    def _below_text(self, found: tuple[int, float, float]) -> str:
        member, points, triangles = found
        what, depth = ("a mass point", points) if points >= triangles else ("a triangle", triangles)
        return (
            f"{what}{self._of(member)} is {depth:.3g} m below the true surface of an obstacle at "
            f"t = {self._core.time:g} s; a larger stiffness or thickness of its layer, or a larger "
            "offset, keeps the cloth out"
        )

    def _stiff_text(self, found: tuple[int, int, float], dt: float) -> str:
        member, k, depth = found
        part = (
            depth / self._scenes[member].spheres[k].layer(self._scenes[member].cloth)["thickness"]
        )
        limit = limit_in_layer(self._scenes[member], self._integrator, k, depth)
        return (
            f"dt = {dt:g} s is above {limit:.3g} s, up to which {self._integrator} is guaranteed "
            f"to be stable with mass points {part:.2g} of its thickness deep in the layer of "
            f"spheres[{k}]{self._of(member)}, as they are at t = {self._core.time:g} s"
        )

    def _limit_at(self, member: int) -> float:
        """The stable time step at the present state of a member."""
        try:
            state = self._state(member)
            limit: float = service("max_stable_dt")(
                self._scenes[member], self._integrator, *state, t=self._core.time
            )
            return limit
        except ValueError:  # points too near for a direction; no reason to end the run
            return self._max_stable_dt[member]

    def _warn_of_growth(self, member: int, dt: float) -> None:
        self.given |= {"dt", "grown", "stiff"}
        limit = self._limit_at(member)
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

    def _holding(self, member: int, k: int, point: int, found: dict[str, Any], dt: float) -> str:
        """What would hold a point that has gone through the layer of an obstacle."""
        scene = self._scenes[member]
        obstacle = scene.spheres[k]
        layer = obstacle.layer(scene.cloth)
        mass = float(scene.cloth.mass_per_point.flat[point])
        velocity = found["v"].reshape(-1, 3)[point] - obstacle.velocity_at(found["time"])
        speed = float(np.linalg.norm(velocity))
        thickness, stiffness = layer["thickness"], layer["stiffness"]
        held = thickness * math.sqrt(stiffness / (2 * mass))
        if speed <= held and self._fixed:
            return (
                f"the layer takes up to {held:.3g} m/s, and the point closes at {speed:.3g} m/s: "
                f"take a dt of at most {min(dt / 2, thickness / (2 * speed)):.3g} s, or rtol"
            )
        if speed <= held:
            return (
                f"forces press the point through: take a stiffness above {stiffness:.3g} N/m, or a "
                f"thickness above {thickness:.3g} m"
            )
        return (
            f"a point at {speed:.3g} m/s is held by a stiffness of "
            f"{2 * mass * (speed / thickness) ** 2:.3g} N/m, here {stiffness:.3g} N/m, or a "
            f"thickness of {speed * math.sqrt(2 * mass / stiffness):.3g} m, here {thickness:.3g} m"
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
        if outcome["obstacle"] >= 0:
            k = outcome["obstacle"]
            raise ContactError(
                **found, obstacle=k, remedy=self._holding(member, k, point, found, dt)
            )
        limit, term = self._limit_of(member, x, dt)
        function = self._forces[member] is not None
        raise UnstableError(**found, dt=dt, max_stable_dt=limit, term=term, function=function)

    def _limit_of(self, member: int, x: Any, dt: float) -> tuple[float, str]:
        """Return the time step that an unstable run suggests, and the term that limits it."""
        scene = self._scenes[member]
        for k, obstacle in enumerate(scene.spheres):
            if obstacle.response != "penalty" or obstacle.motion is None:
                continue
            speed = obstacle.motion.largest_speed
            thickness = obstacle.layer(scene.cloth)["thickness"]
            if speed * dt > thickness:
                text = f"spheres[{k}] moves by more than the thickness of its layer in a step"
                return thickness / speed, text
        limit = self._max_stable_dt[member]
        term = str(limiting_term(scene, self._integrator))
        for k, depth in enumerate(self._depths(member, x, self._core.time)):
            in_layer = limit_in_layer(scene, self._integrator, k, depth) if depth > 0 else math.inf
            if in_layer < limit:
                limit = in_layer
                term = f"mass points are {depth:.3g} m deep in the layer of spheres[{k}]"
        if scene.wind is not None and (at_state := self._limit_at(member)) < limit:
            return at_state, "the wind at the speeds of that state limits it"
        return limit, term

    def _depths(self, member: int, x: Any, t: float) -> list[float]:
        plan = kept_plan(self._scenes[member], Options())
        return [depth for depth, _ in _core.contact_depths(plan, np.ascontiguousarray(x), t)]
