"""A core simulation of one cloth or a batch, for checked input."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..methods.bound import guaranteed_dt
from ..methods.integrators import integrators, warn_of_order
from ..model.as_core import core_cloth
from ..model.motion import Linear
from ..model.scene import Scene
from ..model.sphere import held
from .arrays import (
    FloatArray,
    check_driven_pins,
    check_pins,
    checked_state,
    out_array,
    out_arrays,
    put_driven_pins,
    scenes_of,
    start_time,
)
from .judge import Judge
from .options import Options
from .plan import kept_plan

_ROUNDING = 2.0**-53  # of a float64, as part of it


def own_arrays(scenes: list[Scene], batched: bool) -> tuple[FloatArray, FloatArray]:
    """The scenes' own states."""
    if not batched:
        return scenes[0].initial_position, scenes[0].initial_velocity
    return np.array([one.initial_position for one in scenes]), np.array([one.initial_velocity for one in scenes])


class State:
    """A simulation of the core for checked input. Its `judge` turns outcomes into warnings and errors."""

    def __init__(
        self, scenes: list[Scene], batched: bool, shape: tuple[int, ...], dtype: npt.DTypeLike, t: float, options: Options
    ) -> None:
        """A state without values, with one scene for each member; `batched`: its arrays have a first axis of members."""
        self.batched, self.options, self.integrator = batched, options, options.integrator
        self.shape, self.dtype = shape, np.dtype(dtype)
        self.threads = 1
        plans, stable_dt = self._compiled(scenes)
        if options.backend == "gpu":
            from ..gpu.simulation import Simulation

            simulation = Simulation(scenes, t, options.precision)
            self.core = cast("_core.Simulation", simulation)  # has the methods that are used here
        else:
            self.threads = _core.granted_threads(options.threads_for(scenes[0].cloth.shape, len(scenes)))
            self.core = _core.Simulation(plans, t, self.threads)
        self.core.set_stable_dt(stable_dt)
        method = integrators()[self.integrator]
        self._may_lose_order = method.order_damped < method.order
        self._adopt(scenes, plans, stable_dt)

    @classmethod
    def checked(cls, scene: Scene | Sequence[Scene], x: Any, v: Any, t: float | None, options: Options) -> State:
        """The state of the arguments of a call. A state or time that is not given is that of the scenes.

        Driven pins that are elsewhere are refused.
        """
        scenes, batched, own = scenes_of(scene), not isinstance(scene, Scene), x is None
        time = 0.0 if t is None and own else start_time(t, scenes)
        own_x, own_v = own_arrays(scenes, batched)
        x = own_x if own else x
        v = np.broadcast_to(own_v, np.shape(x)) if v is None else v
        x, v = checked_state(x, v, scenes, batched, options.precision)
        if x.ndim == 4 and not batched:
            scenes = scenes * len(x)
        if not own:
            check_driven_pins(scenes, x, time)
        state = cls(scenes, x.ndim == 4, x.shape, x.dtype, time, options)
        state.core.load(x, v)
        return state

    @classmethod
    def own(cls, scenes: list[Scene], batched: bool, t: float, options: Options) -> State:
        """The scenes' own states at a time [s], unchecked."""
        x, v = own_arrays(scenes, batched)
        state = cls(scenes, batched, x.shape, x.dtype, t, options)
        state.core.load(x, v)
        return state

    def set_scene(self, scene: Scene | Sequence[Scene]) -> None:
        """Replace the scenes, and keep the state. An error leaves everything as it was."""
        scenes = scenes_of(scene) * (len(self.scenes) if isinstance(scene, Scene) else 1)
        plans, stable_dt = self._compiled(scenes)
        self.core.set_scene(plans, stable_dt)
        self._adopt(scenes, plans, stable_dt)

    def _compiled(self, scenes: list[Scene]) -> tuple[list[Any], list[float]]:
        """Plans for the core, or scenes for the adapter, and the guaranteed time step [s] of each member."""
        plans = scenes if self.options.backend == "gpu" else [kept_plan(scene, self.options) for scene in scenes]
        return plans, [guaranteed_dt(core_cloth(scene.cloth), self.integrator) for scene in scenes]

    def _adopt(self, scenes: list[Scene], plans: list[Any], stable_dt: list[float]) -> None:
        self.scenes, self.max_stable_dt = scenes, stable_dt
        on_gpu = self.options.backend == "gpu"
        self.kernel = "gather" if on_gpu else self.options.chosen_kernel
        self.instruction_set = str(cast("Any", self.core).adapter if on_gpu else plans[0].instruction_set)
        self.judge = Judge(self.core, scenes, self.batched, self.integrator, stable_dt)
        self._driven = self._moves = False
        for scene in scenes:
            self._driven |= bool(scene.cloth.driven)
            self._moves |= self._driven or any(sphere.motion is not None for sphere in scene.spheres)

    def step(
        self, x: FloatArray, v: FloatArray, t: float | None, steps: Any, dt: Any, out: Any
    ) -> tuple[FloatArray, FloatArray]:
        """A call of `step`, with float arrays of the shape and type of this state."""
        self.judge.given.clear()
        if t is not None or self._moves:
            t = start_time(t, self.scenes)
        time = t or 0.0
        steps, dt = self._checked(steps, dt, time)
        results = out_arrays(out, self.shape, self.dtype)
        if self._driven:
            check_driven_pins(self.scenes, x, time)
        if self._may_lose_order:
            self.warn_of_order()
        try:
            outcome = self.core.step(time, x, v, steps, dt, self.threads, *results)
        except TypeError:  # arrays that are not contiguous
            outcome = self.core.step(time, *self._arrays(x, v), steps, dt, self.threads, *results)
        if outcome is False:
            self._arrays(x, v)
        if outcome:
            self._go_on(outcome, steps, dt)
            self.core.store(*results)
        return results

    def accelerate(self, x: FloatArray, v: FloatArray, t: Any, out: Any) -> FloatArray:
        """A call of `acceleration`, with float arrays of the shape and type of this state."""
        time = start_time(t, self.scenes)
        result: FloatArray = np.empty(self.shape) if out is None else out
        out_array("out", result, self.shape, np.dtype(np.float64))
        if self._driven:
            check_driven_pins(self.scenes, x, time)
        # Driven pins have the velocity of their motion, and `out` may lie over a part of `x` or `v`.
        whole = x.flags.c_contiguous and v.flags.c_contiguous and not self._driven
        if not (whole and self.core.accelerations(x, v, result, self.threads)):
            self.core.load(*self._arrays(x, v), time)
            self.core.accelerations(result, self.threads)
        return result

    def _arrays(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The arrays, contiguous; a ValueError for numbers that are not finite, or too large for the precision."""
        return checked_state(x, v, self.scenes, self.batched, self.options.precision)

    def advance(self, steps: Any, dt: Any) -> None:
        """Advance all members; see `Stepper.advance`."""
        steps, dt = self._checked(steps, dt, self.core.time)
        outcome = self.core.advance(steps, dt, self.threads)
        if outcome:
            self._go_on(outcome, steps, dt)

    def _checked(self, steps: Any, dt: Any, t: float) -> tuple[int, float]:
        """Return steps and dt as plain numbers; give a `StabilityWarning` if dt is too long. `t`: time of the state [s]."""
        # The form of nearly every call, recognised in a tenth of the time that the checks take.
        if type(steps) is int and type(dt) is float and 0 <= steps < 2**62 and 0.0 < dt <= self.judge.least_stable_dt:
            if t + dt != t:
                return steps, dt
        if isinstance(steps, float) and isinstance(dt, int):
            raise TypeError(
                f"steps must be an integer, got steps={steps!r} and dt={dt!r}, which look "
                "swapped: the order is advance(steps, dt) and step(scene, x, v, dt, steps); "
                "both can be given by name"
            )
        steps = check.integer("steps", steps, minimum=0, maximum=check.INT64_MAX)
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        if t + dt == t:
            raise ValueError(
                f"dt must be above the rounding of the time t = {t:g} s, {abs(t) * _ROUNDING:.3g} s, got {dt!r}: "
                "start at a t nearer to 0"
            )
        self.judge.time_step(dt)
        return steps, dt

    def _go_on(self, outcome: dict[str, Any] | None, steps: int, dt: float) -> None:
        done = 0
        while outcome:
            if "point" in outcome:
                outcome["step"] += done
            self.judge.outcome(outcome, dt)
            if "grown" not in outcome:
                return
            done += outcome["steps"]
            outcome = self.core.advance(steps - done, dt, self.threads)

    def warn_of_order(self) -> None:
        """Give an `OrderWarning` for the first scene for which the integrator loses order."""
        if self._may_lose_order:
            any(warn_of_order(self.integrator, scene) for scene in self.scenes)

    def replace_state(self, x: Any = None, v: Any = None, t: Any = None) -> None:
        """See `Stepper.set_state`."""
        time = None if t is None else check.number("t", t)
        own_x, own_v = np.empty(self.shape), np.empty(self.shape)
        self.core.store(own_x, own_v)
        put_driven_pins(self.scenes, own_x, own_v, self.core.time if time is None else time, self.core.frozen)
        # With float64 for what is not given, the core's own is of float64: the whole state of "single".
        given_x, given_v = own_x if x is None else x, own_v if v is None else v
        new_x, new_v = checked_state(given_x, given_v, self.scenes, self.batched, self.options.precision)
        if new_x.shape != self.shape:
            raise ValueError(f"x and v must have shape {self.shape}, got {new_x.shape}")
        check_pins(self.scenes, new_x, new_v, own_x, own_v)
        self.core.load(None if x is None else new_x, None if v is None else new_v, time)

    def advance_spheres(self, steps: Any, dt: Any, targets: dict[int, npt.NDArray[np.float64]]) -> None:
        """Advance while spheres travel straight to their targets [m]; there they rest."""
        begin = self.core.time
        steps, dt = self._checked(steps, dt, begin)
        starts = {k: [scene.spheres[k].center_at(begin) for scene in self.scenes] for k in targets}
        speeds = {k: [(target - start) / (steps * dt) for start in starts[k]] for k, target in targets.items()}
        for k in targets:
            motions = [Linear(v).core for v in speeds[k]]
            self.core.set_sphere(k, [x - begin * v for x, v in zip(starts[k], speeds[k])], motions)
        arrived = False
        try:
            self.advance(steps, dt)
            arrived = True
        finally:  # where a step has failed, spheres are on their way
            passed = self.core.time - begin
            for k, target in targets.items():
                ends = [target if arrived else x + passed * v for x, v in zip(starts[k], speeds[k])]
                self.core.set_sphere(k, ends, [_core.Motion()] * len(ends))
                self.scenes = [
                    scene.replace(spheres=[held(s, x) if n == k else s for n, s in enumerate(scene.spheres)])
                    for scene, x in zip(self.scenes, ends)
                ]

    def set_force(self, force: FloatArray) -> None:
        """Set the force on each point [N], float64, of the shape of the state."""
        self.core.set_force(force)
        members = force if self.batched else force[None]
        self.scenes = [scene.replace(force=one) for scene, one in zip(self.scenes, members)]
