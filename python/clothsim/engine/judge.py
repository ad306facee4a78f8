"""Warnings and errors of steps, from events of the core."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Sequence
from typing import Any, NoReturn

import numpy as np

from .. import _core
from ..base.services import find_service
from ..errors import ContactError, ContactWarning, StabilityWarning, UnstableError, warn_caller
from ..methods.bound import limiting_term, stable_dt_in_layer
from ..model.obstacle import name_of_kind
from ..model.scene import Scene
from ..typing import Force
from .backend import Simulation
from .options import Options, cached_plan

# Warnings of a time step are of these kinds. Error control chooses the step itself, and gives none.
TIME_STEP = frozenset({"time_step", "grown", "stiff"})


class Judge:
    """A judge of steps, which gives each warning of a simulation once and raises errors.

    `scenes` and the guaranteed time steps `max_stable_dt` [s] have one entry for each member, which
    messages name where the state is `batched`. `quiet` has the kinds of warnings that are not
    given. `past_kinds` has those that were given. An error has the state of `core`.
    """

    def __init__(
        self,
        core: Simulation,
        scenes: Sequence[Scene],
        batched: bool,
        integrator: str,
        max_stable_dt: Sequence[float],
        forces: Sequence[Force | None],
        quiet: Collection[str] = (),
    ) -> None:
        self._core = core
        self._scenes = scenes
        self._batched = batched
        self._integrator = integrator
        self._max_stable_dt = max_stable_dt
        self._forces = forces
        self._quiet = quiet
        self.past_kinds: set[str] = set()
        # Without springs each entry is infinite.
        self.least_stable_dt = min(*max_stable_dt, sys.float_info.max)
        self._warnings: dict[str, tuple[type[Warning], Callable[[_core.Event, float], str]]] = {
            "pinned_inside": (ContactWarning, self._pin_inside_text),
            "below": (ContactWarning, self._cloth_below_text),
            "stiff": (StabilityWarning, self._stiff_layer_text),
            "grown": (StabilityWarning, self._energy_growth_text),
        }

    def forget_warnings(self) -> None:
        """Give all warnings anew, as each call of `step` does."""
        self.past_kinds.clear()

    def _is_quiet(self, kind: str) -> bool:
        # A warning of growth says that the time step is too long.
        repeats_growth = kind in TIME_STEP and "grown" in self.past_kinds
        return kind in self._quiet or kind in self.past_kinds or repeats_growth

    def judge_time_step(self, dt: float) -> None:
        """Warn once of a time step above the guarantee of a member that moves."""
        if dt <= self.least_stable_dt or self._is_quiet("time_step"):
            return
        active = [k for k, frozen in enumerate(self._core.frozen) if not frozen]
        limit, member = min(((self._max_stable_dt[k], k) for k in active), default=(dt, 0))
        if dt > limit:
            self.past_kinds.add("time_step")
            scene = f"batch member {member}" if self._batched else "this scene"
            stable = f"guaranteed to be stable for {scene}"
            text = f"no dt is {stable} with {self._integrator}"
            if limit:
                text = (
                    f"dt = {dt:g} s is above {limit:.3g} s, up to which {self._integrator} is "
                    f"{stable}"
                )
            warn_caller(
                f"{text}; {limiting_term(self._scenes[member], self._integrator)}", StabilityWarning
            )

    def report_events(
        self, events: Sequence[_core.Event], dt: float, steps_before: int = 0
    ) -> None:
        """Give the warnings of a call of the core, and raise the error of a failed step.

        `steps_before`: steps of the run, or of this call of a user, before that of the core.
        """
        for event in events:
            if event.kind not in self._warnings:
                self._raise_error(event, dt, steps_before)
            if self._is_quiet(event.kind):
                continue
            self.past_kinds.add(event.kind)
            category, text = self._warnings[event.kind]
            warn_caller(text(event, dt), category)

    def _member_phrase(self, member: int) -> str:
        return f" of batch member {member}" if self._batched else ""

    def _state_of_member(self, member: int) -> tuple[Any, Any]:
        shape = (*self._scenes[0].cloth.shape, 3)
        x, v = np.empty((2, len(self._scenes), *shape))
        self._core.store(*((x, v) if self._batched else (x[0], v[0])))
        return x[member], v[member]

    def _pin_inside_text(self, event: _core.Event, dt: float) -> str:
        scene = self._scenes[event.member]
        pin = divmod(event.point, scene.cloth.columns)
        return (
            f"the pinned mass point {pin}{self._member_phrase(event.member)} is inside a "
            f"{name_of_kind(scene.spheres)}; no contact moves it, so it, and triangles at it, are "
            "inside while it is there"
        )

    def _cloth_below_text(self, event: _core.Event, dt: float) -> str:
        return (
            f"the cloth{self._member_phrase(event.member)} is {event.value:.3g} m below the true "
            f"surface of an obstacle at t = {event.time:g} s; a larger stiffness or thickness of "
            "its layer, or a larger offset, keeps the cloth out"
        )

    def _stiff_layer_text(self, event: _core.Event, dt: float) -> str:
        scene = self._scenes[event.member]
        k = event.obstacle
        part = event.value / scene.spheres[k].layer(scene.cloth)["thickness"]
        limit = stable_dt_in_layer(scene, self._integrator, k, event.value)
        return (
            f"dt = {dt:g} s is above {limit:.3g} s, up to which {self._integrator} is guaranteed "
            f"to be stable with mass points {part:.2g} of its thickness deep in the layer of "
            f"spheres[{k}]{self._member_phrase(event.member)}, as they are at t = {event.time:g} s"
        )

    def _stable_dt_at_state(self, member: int) -> float:
        """Return the stable time step [s] at the present state of a member."""
        try:
            state = self._state_of_member(member)
            limit: float = find_service("max_stable_dt")(
                self._scenes[member], self._integrator, *state, t=self._core.time
            )
            return limit
        except ValueError:  # Points are too near for a direction, which does not end the run.
            return self._max_stable_dt[member]

    def _energy_growth_text(self, event: _core.Event, dt: float) -> str:
        limit = self._stable_dt_at_state(event.member)
        if not limit:
            reach = "is stable there at no time step"
        elif limit < dt:
            reach = f"is stable at that state up to {limit:.3g} s: take a dt below it"
        else:
            reach = (
                f"is stable at that state up to {limit:.3g} s: states before it bear less; take "
                "a smaller dt"
            )
        return (
            f"energy{self._member_phrase(event.member)} grows out of nothing: at t = "
            f"{event.time:g} s more than half of the kinetic and elastic energy was made "
            f"by the time step dt = {dt:g} s; {self._integrator} {reach}"
        )

    def _remedy_text(self, event: _core.Event, v: Any, dt: float) -> str:
        """Return what would hold a point that has gone through the layer of an obstacle."""
        scene = self._scenes[event.member]
        obstacle = scene.spheres[event.obstacle]
        layer = obstacle.layer(scene.cloth)
        mass = float(scene.cloth.mass_per_point.flat[event.point])
        velocity = v.reshape(-1, 3)[event.point] - obstacle.velocity_at(event.time)
        speed = float(np.linalg.norm(velocity))
        thickness = layer["thickness"]
        stiffness = layer["stiffness"]
        largest = thickness * math.sqrt(stiffness / (2 * mass))  # speed that the layer stops [m/s]
        if speed <= largest and "time_step" not in self._quiet:
            return (
                f"the layer takes up to {largest:.3g} m/s, and the point closes at {speed:.3g} m/s:"
                f" take a dt of at most {min(dt / 2, thickness / (2 * speed)):.3g} s, or rtol"
            )
        if speed <= largest:
            return (
                f"forces press the point through: take a stiffness above {stiffness:.3g} N/m, or a "
                f"thickness above {thickness:.3g} m"
            )
        return (
            f"a point at {speed:.3g} m/s is held by a stiffness of "
            f"{2 * mass * (speed / thickness) ** 2:.3g} N/m, here {stiffness:.3g} N/m, or a "
            f"thickness of {speed * math.sqrt(2 * mass / stiffness):.3g} m, here {thickness:.3g} m"
        )

    def _raise_error(self, event: _core.Event, dt: float, steps_before: int) -> NoReturn:
        cloth = self._scenes[event.member].cloth
        x, v = self._state_of_member(event.member)
        pinned = cloth.pinned.flat[event.point]
        values: dict[str, Any] = {
            "step": steps_before + event.step,
            "time": event.time,
            "point": None if pinned else divmod(event.point, cloth.columns),
            "x": x,
            "v": v,
            "member": event.member if self._batched else None,
        }
        if event.kind == "passed":
            remedy = self._remedy_text(event, v, dt)
            raise ContactError(**values, obstacle=event.obstacle, remedy=remedy)
        limit, term = self._suggested_dt_and_term(event.member, x, dt)
        function = self._forces[event.member] is not None
        raise UnstableError(**values, dt=dt, max_stable_dt=limit, term=term, function=function)

    def _suggested_dt_and_term(self, member: int, x: Any, dt: float) -> tuple[float, str]:
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
        for k, depth in enumerate(self._layer_depths(member, x, self._core.time)):
            in_layer = (
                stable_dt_in_layer(scene, self._integrator, k, depth) if depth > 0 else math.inf
            )
            if in_layer < limit:
                limit = in_layer
                term = f"mass points are {depth:.3g} m deep in the layer of spheres[{k}]"
        if scene.wind is not None and (at_state := self._stable_dt_at_state(member)) < limit:
            return at_state, "the wind at the speeds of that state limits it"
        return limit, term

    def _layer_depths(self, member: int, x: Any, t: float) -> list[float]:
        plan = cached_plan(self._scenes[member], Options())
        return [depth for depth, _ in _core.contact_depths(plan, np.ascontiguousarray(x), t)]
