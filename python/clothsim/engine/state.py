"""A core simulation of one cloth or a batch, for checked input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..methods.bound import guaranteed_dt
from ..methods.integration import integrators, warn_of_order
from ..model.as_core import core_cloth
from ..model.motion import Linear
from ..model.scene import Scene
from ..model.sphere import Sphere
from .arrays import FloatArray, check_driven_pins, check_pins, checked_state, put_driven_pins, scenes_of, start_time
from .judge import Judge
from .options import Options
from .plan import kept_plan
from .start import Start, warn_of_start

_ROUNDING = 2.0**-53  # of a float64, as part of it


@dataclass(frozen=True)
class _Compiled:
    """Plans for the core, or scenes for the adapter, and the guaranteed time step [s] of each member."""

    plans: list[Any]
    stable_dt: list[float]


class State:
    """A simulation of the core. Its `judge` turns outcomes into warnings and errors."""

    def __init__(
        self, scene: Scene | Sequence[Scene], x: Any, v: Any, t: float | None, options: Options, inspect: bool = True
    ) -> None:
        """`inspect`: warn of continuous spheres that are on the cloth, and refuse driven pins that are elsewhere."""
        self._begin(Start.checked(scene, x, v, t, options.precision, inspect), options, inspect)

    @classmethod
    def own(cls, scenes: list[Scene], batched: bool, t: float, options: Options) -> State:
        """The scenes' own states at a time [s], which nobody inspects."""
        state = cls.__new__(cls)
        state._begin(Start.own(scenes, batched, t), options, inspect=False)
        return state

    @staticmethod
    def inspect(scenes: list[Scene], batched: bool, t: float, options: Options) -> None:
        """Check the numbers of the scenes' own states, and warn of continuous spheres that are on the cloth."""
        start = Start.own(scenes, batched, t)
        if options.precision == "single":
            checked_state(start.x, start.v, scenes, batched, options.precision)
        for member, scene in enumerate(scenes):
            if any(sphere.response == "continuous" for sphere in scene.spheres):
                warn_of_start(scene, scene.initial_position, t, member if batched else None)

    def _begin(self, start: Start, options: Options, inspect: bool) -> None:
        self.batched, self.options, self.integrator = start.batched, options, options.integrator
        self.shape, self.dtype = start.x.shape, start.x.dtype
        self.threads = 1
        compiled = self._compiled(start.scenes)
        if options.backend == "gpu":
            from ..gpu.simulation import Simulation

            simulation = Simulation(start.scenes, start.t, options.precision)
            self.core = cast("_core.Simulation", simulation)  # has the methods that are used here
        else:
            wanted = options.threads_for(start.scenes[0].cloth.shape, len(start.scenes))
            self.threads = _core.granted_threads(wanted)
            self.core = _core.Simulation(compiled.plans, start.t, self.threads)
        self.core.set_stable_dt(compiled.stable_dt)
        self._adopt(start.scenes, compiled, inspect)
        method = integrators()[self.integrator]
        self._may_lose_order = method.order_damped < method.order
        self.core.load(start.x, start.v)
        if self._inspected:
            self._warn_of_start(start.x, start.t)

    def set_scene(self, scene: Scene | Sequence[Scene]) -> None:
        """Replace the scenes, and keep the state. An error leaves everything as it was. Spheres that are put on the
        cloth give a warning.
        """
        scenes = scenes_of(scene) * (len(self.scenes) if isinstance(scene, Scene) else 1)
        compiled = self._compiled(scenes)
        self.core.set_scene(compiled.plans, compiled.stable_dt)
        known = [one.spheres for one in self.scenes]
        self._adopt(scenes, compiled, inspect=False)
        if any(sphere.response == "continuous" for one in scenes for sphere in one.spheres):
            x = np.empty(self.shape)
            self.store(x, None)
            self._warn_of_start(x, self.core.time, known)

    def _compiled(self, scenes: list[Scene]) -> _Compiled:
        """Compile the scenes."""
        found, on_gpu = _Compiled([], []), self.options.backend == "gpu"
        for scene in scenes:
            found.plans.append(scene if on_gpu else kept_plan(scene, self.options))
            found.stable_dt.append(guaranteed_dt(core_cloth(scene.cloth), self.integrator))
        return found

    def _adopt(self, scenes: list[Scene], compiled: _Compiled, inspect: bool) -> None:
        self.scenes, self.max_stable_dt = scenes, compiled.stable_dt
        on_gpu = self.options.backend == "gpu"
        self.kernel = "gather" if on_gpu else self.options.kernel_for(scenes[0].cloth)
        self.instruction_set = str(cast("Any", self.core).adapter if on_gpu else compiled.plans[0].instruction_set)
        self.judge = Judge(self.core, scenes, self.batched, self.integrator, compiled.stable_dt)
        self._driven = self._moves = self._inspected = False
        for scene in scenes:
            self._driven |= bool(scene.cloth.driven)
            for sphere in scene.spheres:
                self._moves |= sphere.motion is not None
                self._inspected |= inspect and sphere.response == "continuous"
        self._moves |= self._driven

    def _warn_of_start(self, x: FloatArray, t: float, but: Sequence[Sequence[Sphere]] = ()) -> None:
        """`but`: for each member, the spheres that give no warning."""
        for member, one in enumerate(x if self.batched else x[None]):
            warn_of_start(self.scenes[member], one, t, member if self.batched else None, but[member] if but else ())

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
        self.judge.forget_warnings()
        if t is not None or self._moves:
            t = start_time(t, self.scenes)
        steps, dt = self._checked(steps, dt, t or 0.0)
        if self._driven:
            check_driven_pins(self.scenes, x, t or 0.0)
        if self._inspected:
            self._warn_of_start(x, t or 0.0)
        if self._may_lose_order:
            self.warn_of_order()
        try:
            outcome = self.core.step(t or 0.0, x, v, steps, dt, self.threads, *out)
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
        if type(t) is not float or not isfinite(t) or self._driven:
            return None
        if self._inspected:
            self._warn_of_start(x, t)
        try:
            return out if self.core.accelerations(x, v, out, self.threads) else None
        except TypeError:
            return None

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
        """Give the warnings and errors of an outcome, then do the remaining steps."""
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

    def replace_state(self, x: Any = None, v: Any = None, t: Any = None, pins_stay: bool = True) -> None:
        """See `Stepper.set_state`. `pins_stay`: refuse another place or velocity of a pin."""
        time = None if t is None else check.number("t", t)
        own_x, own_v = np.empty(self.shape), np.empty(self.shape)
        self.store(own_x, own_v)
        put_driven_pins(self.scenes, own_x, own_v, self.core.time if time is None else time, self.core.frozen)
        # With float64 for what is not given, the core's own is of float64: the whole state of "single".
        given_x, given_v = own_x if x is None else x, own_v if v is None else v
        new_x, new_v = checked_state(given_x, given_v, self.scenes, self.batched, self.options.precision)
        if new_x.shape != self.shape:
            raise ValueError(f"x and v must have shape {self.shape}, got {new_x.shape}")
        if pins_stay:
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
                    scene.replace(
                        spheres=[s.replace(center=x, motion=None) if n == k else s for n, s in enumerate(scene.spheres)]
                    )
                    for scene, x in zip(self.scenes, ends)
                ]

    def set_force(self, force: FloatArray) -> None:
        """Set the force on each point [N], float64, of the shape of the state."""
        self.core.set_force(force)
        members = force if self.batched else force[None]
        self.scenes = [scene.replace(force=one) for scene, one in zip(self.scenes, members)]

    def store(self, x: FloatArray | None, v: FloatArray | None) -> None:
        """Write positions and velocities into the arrays that are not None."""
        self.core.store(x, v)
