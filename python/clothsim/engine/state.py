"""The state of one cloth or a batch, and a core simulation around it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import isfinite
from typing import Any, cast

import numpy as np

from .. import _core
from ..base import check
from ..base.clocks import seconds_per_step
from ..errors import ContactError, ContactWarning, LongRunWarning, UnstableError, warn_caller, warn_of_dt, warn_of_growth
from ..methods.bound import guaranteed_dt
from ..methods.integration import integrators, warn_of_order
from ..methods.limiting import limiting_term
from ..model.as_core import core_cloth
from ..model.scene import Scene
from .arrays import FloatArray, checked_state, scenes_of, start_time
from .plan import check_backend, check_options, choose_kernel, choose_threads, core_plan, point_radius

MANY_STEPS = 1_000_000
"""A run of more steps is announced, with the time that it will take."""

# Copies of the state are stepped for so long to tell the time of a step, four times, of which the first warms
# caches and threads. Half as long is noisy on a busy machine; twice as long is felt.
_SECONDS_TIMED = 0.02
_TIMINGS = 4
_MOST_STEPS_TIMED = 20_000


def duration_text(seconds: float) -> str:
    """A duration in words, of two digits."""
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"


def _start(x: Any, v: Any, scenes: Sequence[Scene], batched: bool) -> tuple[Any, Any]:
    """The state of a call; what it leaves out is the scenes' own."""
    if x is None:
        x = np.stack([s.initial_position for s in scenes]) if batched else scenes[0].initial_position
    if v is None:
        v = np.stack([s.initial_velocity for s in scenes]) if batched else scenes[0].initial_velocity
        v = np.broadcast_to(v, np.shape(x))
    return x, v


class State:
    """A simulation of the core: arguments are checked, and its outcomes become results, warnings and errors."""

    def __init__(
        self,
        scene: Scene | Sequence[Scene],
        x: Any,
        v: Any,
        *,
        t: float | None,
        integrator: str,
        precision: str,
        threads: int | None,
        kernel: str,
        strict: bool,
        backend: str = "cpu",
        inspect: bool = True,
    ) -> None:
        """`inspect`: warn of continuous spheres that are on the cloth."""
        scenes = scenes_of(scene)
        batched = not isinstance(scene, Scene)
        integrator = check_options(precision, kernel, strict, integrator)
        check_backend(backend, kernel, threads, integrator)
        t = 0.0 if t is None and x is None else start_time(t, scenes)
        self._options: dict[str, Any] = {
            "t": t,
            "integrator": integrator,
            "precision": precision,
            "threads": threads,
            "kernel": kernel,
            "strict": strict,
            "backend": backend,
            "inspect": False,
        }
        x, v = _start(x, v, scenes, batched)
        x, v = checked_state(x, v, scenes, batched, precision)
        self.batched = x.ndim == 4
        members = len(x) if self.batched else 1
        self.scenes = scenes if batched else scenes * members
        self.shape, self.dtype = x.shape, x.dtype
        self.integrator = integrator
        method = integrators()[integrator]
        self._may_lose_order = method.order_damped < method.order
        self.threads_optional = threads is None
        self.backend = backend
        if backend == "gpu":
            self._use_gpu(t, precision, strict)
            cloths = [core_cloth(s) for s in scenes]
        else:
            plans = [core_plan(s, precision, kernel, strict, integrator) for s in scenes]
            self._use_cpu(plans if batched else plans * members, t, threads)
            self.kernel = choose_kernel(kernel, strict, scenes[0].cloth)
            cloths = [plan.cloth for plan in plans]
        limits = [guaranteed_dt(cloth, integrator) for cloth in cloths]
        self.max_stable_dt = limits if batched else limits * members
        self._least_stable_dt = min(*self.max_stable_dt, sys.float_info.max)  # inf without springs
        self.core.set_stable_dt(self.max_stable_dt)
        self.warned = self.warned_of_growth = self.announced = False
        self.steps_before = 0  # earlier calls of the run; errors count steps from its start
        self.core.load(x, v)
        self._warned_of_pins = False
        spheres = [sphere for one in scenes for sphere in one.spheres]
        self._moves = any(sphere.motion is not None for sphere in spheres)
        self._inspected = inspect and any(sphere.response == "continuous" for sphere in spheres)
        self._warn_of_start(x, t)

    def _warn_of_start(self, x: FloatArray, t: float) -> None:
        if self._inspected:
            for member, one in enumerate(x if self.batched else x[None]):
                warn_of_start(self.scenes[member], one, t, member if self.batched else None)

    def call(
        self, x: FloatArray, v: FloatArray, t: float | None, steps: Any, dt: Any, out: Any
    ) -> tuple[FloatArray, FloatArray] | None:
        """One call of `step` with arrays of known shape. Returns None, and does nothing, where the arguments need full
        checks.
        """
        if out is None:
            out = np.empty(self.shape, self.dtype), np.empty(self.shape, self.dtype)
        elif not (type(out) is tuple and len(out) == 2 and type(out[0]) is type(out[1]) is np.ndarray):
            return None
        self.warned = self.warned_of_growth = self.announced = self._warned_of_pins = False
        if t is not None or self._moves:
            t = start_time(t, self.scenes)
        steps, dt = self._checked(steps, dt)
        if steps > MANY_STEPS:
            return None
        if self._inspected:
            self._warn_of_start(x, t or 0.0)
        if self._may_lose_order:
            self.warn_of_order()
        try:
            outcome = self.core.step(t or 0.0, x, v, steps, dt, self.threads, self.threads_optional, *out)
        except TypeError:  # of another dtype, or not contiguous
            return None
        if outcome is False:
            return None
        if outcome:
            self._go_on(outcome, steps, dt)
            self.store(*out)
        return out[0], out[1]

    def accelerate(self, x: FloatArray, v: FloatArray, t: float, out: Any) -> FloatArray | None:
        """One call of `acceleration`, see `call`."""
        if out is None:
            out = np.empty(self.shape)
        elif type(out) is not np.ndarray:
            return None
        if type(t) is not float or not isfinite(t):
            return None
        if self._inspected:
            self._warn_of_start(x, t)
        try:
            return out if self.core.accelerations(x, v, out, self.threads) else None
        except TypeError:
            return None

    def _use_cpu(self, plans: list[_core.Plan], t: float, threads: int | None) -> None:
        self.threads = choose_threads(threads, self.scenes[0].cloth.shape, len(plans))
        self.instruction_set = plans[0].instruction_set
        self.core = _core.Simulation(plans, t, self.threads)

    def _use_gpu(self, t: float, precision: str, strict: bool) -> None:
        from ..gpu.simulation import Simulation

        simulation = Simulation(self.scenes, t, precision, strict)
        self.core = cast("_core.Simulation", simulation)  # has the methods that are used here
        self.threads, self.kernel = 1, "gather"
        self.instruction_set = str(simulation.adapter)

    def advance(self, steps: Any, dt: Any) -> None:
        """Advance all members; see `Stepper.advance`."""
        steps, dt = self._checked(steps, dt)
        self.announce(steps, dt)
        outcome = self.core.advance(steps, dt, self.threads, self.threads_optional)
        if outcome:
            self._go_on(outcome, steps, dt)

    def _checked(self, steps: Any, dt: Any) -> tuple[int, float]:
        """Return steps and dt as plain numbers; give a `StabilityWarning` if dt is too long."""
        # What nearly every call is, told apart in a tenth of the time that the checks take.
        if type(steps) is int and type(dt) is float and 0 <= steps <= MANY_STEPS and 0.0 < dt <= self._least_stable_dt:
            return steps, dt
        if isinstance(steps, float) and isinstance(dt, int):
            raise TypeError(
                f"steps must be an integer, got steps={steps!r} and dt={dt!r}, which look "
                "swapped: the order is advance(steps, dt) and step(scene, x, v, dt, steps); "
                "both can be given by name"
            )
        steps = check.integer("steps", steps, minimum=0, maximum=check.INT64_MAX)
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        self._warn(dt)
        return steps, dt

    def _go_on(self, outcome: dict[str, Any] | None, steps: int, dt: float) -> None:
        """Give the warnings and errors of an outcome, then do the remaining steps."""
        done = 0
        while outcome:
            if "point" in outcome:
                outcome["step"] += done
            self.judge(outcome, dt)
            if "grown" not in outcome:
                return
            done += outcome["steps"]
            outcome = self.core.advance(steps - done, dt, self.threads, self.threads_optional)

    def judge(self, outcome: dict[str, Any], dt: float) -> None:
        """Give a warning for each finding of the core, and raise an error for a failed step."""
        if "pinned_inside" in outcome and not self._warned_of_pins:
            self._warned_of_pins = True
            member, point = outcome["pinned_inside"]
            where = divmod(point, self.scenes[member].cloth.columns)
            warn_caller(
                f"a sphere has run into the pinned mass point {where}"
                f"{f' of batch member {member}' if self.batched else ''}; a pinned point never "
                "moves, so it, and triangles at it, are inside while the sphere is there",
                ContactWarning,
            )
        if "grown" in outcome:
            self._warn_of_growth(outcome["grown"], dt)
        if "point" in outcome:
            self._raise_error(outcome, dt)

    def _warn_of_growth(self, member: int, dt: float) -> None:
        if self.warned_of_growth:
            return
        self.warned_of_growth = True
        x, v = np.empty(self.shape), np.empty(self.shape)
        self.core.store(x, v)
        state = (x[member], v[member]) if self.batched else (x, v)
        from ..stability.limit import max_stable_dt

        try:
            limit = max_stable_dt(self.scenes[member], self.integrator, *state)
        except ValueError:  # points too near for a direction; no reason to end the run
            limit = self.max_stable_dt[member]
        which = member if self.batched else None
        warn_of_growth(self.core.time, dt, limit, self.integrator, which)

    def warn_of_order(self) -> None:
        """Give an `OrderWarning` for the first scene for which the integrator loses order."""
        if self._may_lose_order:
            any(warn_of_order(self.integrator, scene) for scene in self.scenes)

    def announce(self, steps: float, dt: float) -> None:
        """Give one `LongRunWarning` before a run of too many steps."""
        if self.announced or steps <= MANY_STEPS:
            return
        self.announced = True
        seconds = steps * self._seconds_per_step(dt)
        term = limiting_term(self.scenes[0], self.integrator)
        why = f"; {term}" if dt >= term.max_stable_dt / 4 else ""  # the limit made it short
        warn_caller(f"{steps:,.0f} steps of {dt:.3g} s will take about {duration_text(seconds)}{why}", LongRunWarning)

    def _seconds_per_step(self, dt: float) -> float:
        """Measure the time of a step on a copy of this state, for about 0.05 s."""
        x, v = np.empty(self.shape, self.dtype), np.empty(self.shape, self.dtype)
        self.store(x, v)
        copy = State(self.scenes if self.batched else self.scenes[0], x, v, **self._options)
        copy.warned = copy.warned_of_growth = copy.announced = True
        return seconds_per_step(lambda steps: copy.advance(steps, dt), _SECONDS_TIMED, _TIMINGS, _MOST_STEPS_TIMED)

    def _warn(self, dt: float) -> None:
        if self.warned or dt <= self._least_stable_dt:
            return
        active = [k for k, frozen in enumerate(self.core.frozen) if not frozen]
        limit, member = min(((self.max_stable_dt[k], k) for k in active), default=(dt, 0))
        if dt > limit:
            self.warned = True
            term = str(limiting_term(self.scenes[member], self.integrator))
            warn_of_dt(dt, limit, self.integrator, member if self.batched else None, term)

    def _raise_error(self, outcome: dict[str, Any], dt: float) -> None:
        x, v = np.empty(self.shape), np.empty(self.shape)
        self.core.store(x, v)
        member = outcome["member"]
        scene = self.scenes[member]
        if outcome["trapped"]:
            raise ContactError(
                step=self.steps_before + outcome["step"],
                time=outcome["time"],
                point=divmod(outcome["point"], scene.cloth.columns),
                x=x[member] if self.batched else x,
                v=v[member] if self.batched else v,
                member=member if self.batched else None,
            )
        raise UnstableError(
            step=self.steps_before + outcome["step"],
            time=outcome["time"],
            point=divmod(outcome["point"], scene.cloth.columns),
            dt=dt,
            max_stable_dt=self.max_stable_dt[member],
            term=str(limiting_term(scene, self.integrator)),
            x=x[member] if self.batched else x,
            v=v[member] if self.batched else v,
            member=member if self.batched else None,
        )

    def store(self, x: FloatArray | None, v: FloatArray | None) -> None:
        """Write positions and velocities into the arrays that are not None."""
        self.core.store(x, v)


# Rounding of float32 positions, as part of the radius and the distance of the centre.
_START_ROUNDING = 1e-6


def warn_of_start(scene: Scene, x: FloatArray, t: float, member: int | None) -> None:
    """Warn where a continuous sphere is on the cloth at the start, with the deepest point."""
    for k, sphere in enumerate(scene.spheres):
        if sphere.response != "continuous":
            continue
        radius, center = point_radius(sphere, scene.cloth), sphere.center_at(t)
        with np.errstate(invalid="ignore"):  # what is not finite is told by the checks
            depth = radius - np.linalg.norm(x.astype(np.float64) - center, axis=-1)
        inside = depth > _START_ROUNDING * (radius + np.abs(center).sum())
        if not inside.any():
            continue
        row, column = (int(n) for n in np.unravel_index(np.argmax(depth), depth.shape))
        warn_caller(
            f"spheres[{k}] starts on the cloth{'' if member is None else f' of member {member}'}: "
            f"{int(inside.sum())} mass points are inside, the deepest, {(row, column)}, by "
            f"{depth[row, column]:.3g} m; they are pushed out at {sphere.push_out_speed:g} m/s "
            "at most (push_out_speed)",
            ContactWarning,
        )
