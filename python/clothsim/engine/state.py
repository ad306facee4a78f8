"""A core simulation of one cloth or a batch, and the checks of what calls hand to it."""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..base.interrupts import Interrupts
from ..base.services import find_service
from ..errors import ContactWarning, warn_caller
from ..methods.bound import stable_dt, stable_layer_depths
from ..methods.integrators import METHODS, check_integrator_name, warn_of_order
from ..model.motion import Linear
from ..model.obstacle import name_of_kind
from ..model.scene import Scene
from ..typing import Force
from .backend import Simulation
from .force import force_of_each_scene, needs_python, plan_with_force
from .judge import Judge
from .options import Options, cached_plan

# float32 or float64, as the caller gave it: a state that is stepped stays of its type.
FloatArray = npt.NDArray[Any]

_ROUNDING = 2.0**-53  # of a float64, as part of it
# Rounding of float32 positions, as part of the size of the cloth and of the distance from the
# origin. Half of it refuses float32 states; with twice as much a pin may jump by 2 um on a sheet of
# a metre.
_PLACE_ROUNDING = 1e-6
_LONGEST_PIECE = 0.05  # s, of steps between two questions for Ctrl-C


def list_scenes(scene: Scene | Sequence[Scene]) -> list[Scene]:
    """Return `scene` as a list of scenes of one shape."""
    if isinstance(scene, Scene):
        return [scene]
    accepted = "a Scene or a non-empty sequence of Scene of one shape"
    if not isinstance(scene, Sequence) or isinstance(scene, (str, bytes)):
        raise TypeError(f"scene must be {accepted}, got {check.value_text(scene)}")
    for k, member in enumerate(scene):
        if not isinstance(member, Scene):
            raise TypeError(f"scene must be {accepted}, got {type(member).__name__} at index {k}")
    shapes = {member.cloth.shape for member in scene}
    if len(shapes) != 1:
        raise ValueError(f"scene must be {accepted}, got the shapes {sorted(shapes)}")
    return list(scene)


def check_state_array(name: str, value: Any, scenes: list[Scene], batched: bool) -> FloatArray:
    """Return `value` as a finite, C-contiguous float32 or float64 array, a copy only if necessary.

    Its shape is (rows, columns, 3), or (B, rows, columns, 3). If the scenes came as a sequence
    (`batched`), B is their number, else B is free.
    """
    shape = (*scenes[0].cloth.shape, 3)
    shapes = (
        f"({len(scenes)}, {shape[0]}, {shape[1]}, 3)"
        if batched
        else f"{shape} or (B, {shape[0]}, {shape[1]}, 3)"
    )
    accepted = f"an array of shape {shapes} of finite numbers"
    array = check.as_array(name, value, accepted)
    members = array.shape[0] if array.ndim == 4 else 0
    fits = members == len(scenes) if batched else array.ndim == 3 or members > 0
    if array.shape[-3:] != shape or not fits:
        raise ValueError(f"{name} must be {accepted}, got shape {array.shape}")
    dtype = np.float32 if array.dtype == np.float32 else np.float64
    result = np.require(array, dtype, ("C", "A"))
    check.check_all(name, result, np.isfinite(result), accepted, points=True)
    return result


def check_state_arrays(
    x: Any, v: Any, scenes: list[Scene], batched: bool, precision: str = "double"
) -> tuple[FloatArray, FloatArray]:
    """Check `x` and `v`, and return them with one shape and dtype (the wider of the two).

    Their numbers are in the range of the precision.
    """
    x = check_state_array("x", x, scenes, batched)
    v = check_state_array("v", v, scenes, batched)
    if x.shape != v.shape:
        raise ValueError(f"x and v must have one shape, got {x.shape} and {v.shape}")
    dtype = np.result_type(x, v)
    if precision == "single" and dtype == np.float64:
        largest = float(np.finfo(np.float32).max)
        for name, array in (("x", x), ("v", v)):
            accepted = f"at most {largest:.3g} in size with precision 'single'"
            check.check_all(name, array, np.abs(array) <= largest, accepted)
    return x.astype(dtype, copy=False), v.astype(dtype, copy=False)


def check_or_make_out_arrays(
    out: Any, shape: tuple[int, ...], dtype: np.dtype[Any]
) -> tuple[FloatArray, FloatArray]:
    """Check that `out` is two arrays that can hold the results; return new ones if it is None."""
    if out is None:
        return np.empty(shape, dtype), np.empty(shape, dtype)
    x, v = (
        out
        if type(out) is tuple and len(out) == 2
        else check.list_of_items("out", out, 2, "arrays (x, v)")
    )
    check_out_array("out[0]", x, shape, dtype)
    check_out_array("out[1]", v, shape, dtype)
    if x is v or (np.may_share_memory(x, v) and np.shares_memory(x, v)):
        raise ValueError("out must be two arrays that share no memory, got arrays that overlap")
    return x, v


def check_out_array(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Check that `array` can be written to in place of a new array."""
    if (
        type(array) is np.ndarray
        and array.dtype == dtype
        and array.shape == shape
        and array.flags.carray
    ):
        return
    accepted = f"a writeable, C-contiguous, aligned {dtype} array of shape {shape}"
    if not isinstance(array, np.ndarray):
        raise TypeError(f"{name} must be {accepted}, got {check.value_text(array)}")
    flags = array.flags
    raise ValueError(
        f"{name} must be {accepted}, got {array.dtype} of shape {array.shape}, writeable "
        f"{flags.writeable}, C-contiguous {flags.c_contiguous}, aligned {flags.aligned}"
    )


def check_start_time(t: Any, scenes: Sequence[Scene]) -> float:
    """Check the time `t` [s]. None means 0, and is refused where a sphere or a pin moves."""
    if type(t) is float and math.isfinite(t):
        return t
    if t is not None:
        return check.number("t", t)
    for scene in scenes:
        moving = [
            (name_of_kind([sphere]), f"spheres[{k}]")
            for k, sphere in enumerate(scene.spheres)
            if sphere.motion is not None
        ]
        moving += [("pin", f"pins[{pin}]") for pin in scene.cloth.driven]
        moving += [("wind", "wind")] if scene.wind and scene.wind.motion else []
        if moving:
            raise ValueError(
                f"t must be given where a {moving[0][0]} moves, and {moving[0][1]} has a motion: "
                "give the time of this state in seconds, t=0.0 if it is the start"
            )
    return 0.0


def check_driven_pins(
    scenes: Sequence[Scene], x: FloatArray, t: float, frozen: Sequence[bool] = ()
) -> None:
    """Refuse positions in which a driven pin is not where its motion puts it at the time `t`,
    except in frozen members.
    """
    for member, scene in enumerate(scenes):
        if frozen and frozen[member]:
            continue
        points = x[member] if x.ndim == 4 else x
        for pins in scene.driven_pins:
            places = pins.places_at(t)
            off = np.abs(points[pins.rows, pins.columns] - places).max(axis=1)
            bad = off > _PLACE_ROUNDING * (max(scene.cloth.size) + np.abs(places).max(axis=1))
            if bad.any():
                k = int(bad.argmax())
                point = int(pins.rows[k]), int(pins.columns[k])
                raise ValueError(
                    f"x must have the driven pin {point} at its place at t = {t:g} s, "
                    f"{places[k].tolist()}, got {points[point].tolist()}"
                )


def put_driven_pins(
    scenes: Sequence[Scene], x: FloatArray, v: FloatArray, t: float, frozen: Sequence[bool] = ()
) -> None:
    """Write places and velocities of driven pins at the time `t` into a state, except those of
    frozen members.
    """
    for member, scene in enumerate(scenes):
        if frozen and frozen[member]:
            continue
        for pins in scene.driven_pins:
            at = (pins.rows, pins.columns) if x.ndim == 3 else (member, pins.rows, pins.columns)
            x[at] = pins.places_at(t)
            v[at] = pins.motion._velocities_at(np.array(t))


def check_pins(
    scenes: Sequence[Scene], x: FloatArray, v: FloatArray, own_x: FloatArray, own_v: FloatArray
) -> None:
    """Refuse a state that would move a pin or change its velocity."""
    for member, scene in enumerate(scenes):
        part = member if x.ndim == 4 else ...
        size = max(scene.cloth.size)
        for name, values, own, scale in (
            ("x", x[part], own_x[part], size),
            ("v", v[part], own_v[part], 0.0),
        ):
            off = np.abs(values - own) > _PLACE_ROUNDING * (scale + np.abs(own))
            bad = np.argwhere(off.any(axis=-1) & scene.cloth.pinned)
            if bad.size:
                point = tuple(int(n) for n in bad[0])
                raise ValueError(
                    f"{name} must be {own[point].tolist()} at the pin {point}, got "
                    f"{values[point].tolist()}; "
                    "driven pins move: Cloth(pins={(row, column): cs.Linear(velocity)})"
                )


def check_depths(scenes: Sequence[Scene], x: FloatArray, t: float, start: bool = False) -> None:
    """Refuse positions with a free point too deep in an obstacle of response "penalty".

    A start must be outside the true surface; any state may be as deep below the contact surface as
    the layer is thick. A start that is deep in a layer gives a `ContactWarning`.
    """
    for member, scene in enumerate(scenes):
        if not scene.has_layers:
            continue
        points = np.ascontiguousarray(x[member] if x.ndim == 4 else x, np.float64)
        depths = _core.contact_depths(cached_plan(scene, Options()), points, t)
        for k, (depth, point) in enumerate(depths):
            if not depth > 0:
                continue
            obstacle = scene.spheres[k]
            layer = obstacle.layer(scene.cloth)
            offset = obstacle.offset_length(scene.cloth)
            below = depth - layer["thickness"]
            allowed = min(offset, layer["thickness"]) if start else layer["thickness"]
            place = divmod(point, scene.cloth.columns)
            where = f"spheres[{k}]" + (f" of member {member}" if x.ndim == 4 else "")
            if below > allowed + _PLACE_ROUNDING * max(scene.cloth.size):
                accepted = "its true surface" if start else "its layer"
                raise ValueError(
                    f"{'position' if start else 'x'} must have the free mass points outside "
                    f"{accepted}, got mass point {place} {below - offset:.3g} m below the true "
                    f"surface of {where} at t = {t:g} s"
                )
            weight = scene.cloth.mass_per_point[place] * 9.8 * max(scene.cloth.spacing)
            energy = layer["stiffness"] * depth**4 / (4 * layer["thickness"] ** 2)
            if start and energy > weight:
                warn_caller(
                    f"mass point {place} starts {depth:.3g} m deep in the layer of {where}: that "
                    f"contact has {energy:.3g} J, and throws the point out",
                    ContactWarning,
                )


def check_sphere_targets(
    centers: Any, scenes: Sequence[Scene]
) -> dict[int, npt.NDArray[np.float64]]:
    """Check `centers` of `Stepper.advance`."""
    if not isinstance(centers, Mapping):
        raise TypeError(
            f"centers must be a mapping of spheres' indices to centres, "
            f"got {check.value_text(centers)}"
        )
    count = min(len(scene.spheres) for scene in scenes)
    if centers and not count:
        raise ValueError(
            f"centers must be None for a scene without spheres, got {check.value_text(centers)}"
        )
    keys = [check.integer("centers", k, minimum=0, maximum=count - 1) for k in centers]
    return {
        k: np.array(check.vector(f"centers[{k}]", center))
        for k, center in zip(keys, centers.values())
    }


def initial_arrays(scenes: list[Scene], batched: bool) -> tuple[FloatArray, FloatArray]:
    """Return the scenes' own states."""
    if not batched:
        return scenes[0].initial_position, scenes[0].initial_velocity
    x = np.array([scene.initial_position for scene in scenes])
    v = np.array([scene.initial_velocity for scene in scenes])
    return x, v


class State:
    """A simulation of the core for checked input. `judge` makes warnings and errors of events."""

    def __init__(
        self,
        scenes: list[Scene],
        batched: bool,
        shape: tuple[int, ...],
        dtype: npt.DTypeLike,
        t: float,
        options: Options,
        forces: Sequence[Force | None] = (),
        quiet: Collection[str] = (),
    ) -> None:
        """Make a state without values, with one scene for each member.

        `batched`: its arrays have a first axis of members; `forces`: of functions, one for each
        member; `quiet`: kinds of warnings that are not given (`Judge`).
        """
        self.batched = batched
        self.options = options
        self.integrator = options.integrator
        self._quiet = quiet
        self.forces = [*forces] or [None] * len(scenes)
        self.forced = self.forces.count(None) < len(scenes)
        self.shape = shape
        self.dtype = np.dtype(dtype)
        # A stepper sets its scene, or those of its members, as it returns them.
        self.scene_of_caller: Scene | Sequence[Scene] = ()
        self.scene_references: list[
            weakref.ref[Scene]
        ] = []  # of an engine that waits: those of its batch
        self.threads = 1
        if self.forced and options.backend == "gpu":
            raise ValueError("force must be None with backend 'gpu'; backend='cpu' has it")
        plans, limits = self._compile_plans(scenes)
        self.core: Simulation
        if options.backend == "gpu":
            self.core = find_service("Simulation")(scenes, t, options.precision)
        else:
            self.threads = _core.granted_threads(
                options.thread_count_for(scenes[0].cloth.shape, len(scenes))
            )
            if len(scenes) > 1 and any(map(needs_python, self.forces)):
                self.threads = 1  # that of the caller, which alone may call Python
            self.core = _core.Simulation(plans, t, self.threads)
        self.core.set_stable_dt(limits)
        self._may_lose_order = not METHODS[self.integrator].damped
        self._adopt_plans(scenes, plans, limits)

    @classmethod
    def from_arguments(
        cls,
        scene: Scene | Sequence[Scene],
        x: Any,
        v: Any,
        t: float | None,
        options: Options,
        force: Any = None,
        quiet: Collection[str] = (),
    ) -> State:
        """Return the state of the arguments of a call. A state or time that is not given is that of
        the scenes.

        Driven pins that are elsewhere are refused.
        """
        scenes = list_scenes(scene)
        batched = not isinstance(scene, Scene)
        own = x is None
        check_integrator_name(options.integrator, fixed=True)
        time = 0.0 if t is None and own else check_start_time(t, scenes)
        own_x, own_v = initial_arrays(scenes, batched)
        x = own_x if own else x
        v = np.broadcast_to(own_v, np.shape(x)) if v is None else v
        x, v = check_state_arrays(x, v, scenes, batched, options.precision)
        if x.ndim == 4 and not batched:
            scenes = scenes * len(x)
        if not own:
            check_driven_pins(scenes, x, time)
        check_depths(scenes, x, time, start=own)
        forces = force_of_each_scene(force, scenes, batched)
        state = cls(scenes, x.ndim == 4, x.shape, x.dtype, time, options, forces, quiet)
        state.core.load(x, v)
        return state

    @classmethod
    def from_scenes(
        cls,
        scenes: list[Scene],
        batched: bool,
        t: float,
        options: Options,
        forces: Sequence[Force | None] = (),
        quiet: Collection[str] = (),
    ) -> State:
        """Return the scenes' own states at a time [s], unchecked."""
        x, v = initial_arrays(scenes, batched)
        check_depths(scenes, x, t, start=True)
        state = cls(scenes, batched, x.shape, x.dtype, t, options, forces, quiet)
        state.core.load(x, v)
        return state

    def set_scene(self, scene: Scene | Sequence[Scene]) -> None:
        """Replace the scenes, and keep the state. An error leaves everything as it was."""
        scenes = list_scenes(scene) * (len(self.scenes) if isinstance(scene, Scene) else 1)
        plans, limits = self._compile_plans(scenes)
        x, _ = self.positions_and_velocities()
        check_depths(scenes, x, self.core.time, start=True)
        with Interrupts():  # the core and its record change together
            self.core.set_scene(plans, limits)
            self._adopt_plans(scenes, plans, limits)
            self.scene_of_caller = scene

    def _compile_plans(self, scenes: list[Scene]) -> tuple[list[Any], list[float]]:
        """Return plans for the core, or scenes for the adapter, and the guaranteed steps [s]."""
        plans: list[Any] = scenes
        if self.options.backend != "gpu":
            plans = [cached_plan(scene, self.options) for scene in scenes]
        if self.forced:
            plans = [
                plan_with_force(plan, force, scenes[0].cloth.shape)
                for plan, force in zip(plans, self.forces, strict=True)
            ]
        return plans, [stable_dt(scene, self.integrator) for scene in scenes]

    def _adopt_plans(self, scenes: list[Scene], plans: list[Any], limits: list[float]) -> None:
        self.scenes = scenes
        self.max_stable_dt = limits
        on_gpu = self.options.backend == "gpu"
        self.kernel = "gather" if on_gpu else self.options.chosen_kernel
        self.instruction_set = self.core.instruction_set
        self.judge = Judge(
            self.core, scenes, self.batched, self.integrator, limits, self.forces, self._quiet
        )
        self._dt_of_depths = math.nan  # the time step whose stable depths the core has
        self._has_layers = self._driven = self._moves = False
        for scene in scenes:
            self._has_layers |= scene.has_layers
            self._driven |= bool(scene.cloth.driven)
            self._moves |= self._driven or any(
                sphere.motion is not None for sphere in scene.spheres
            )
            self._moves |= scene.wind is not None and scene.wind.motion is not None

    def step(
        self, x: FloatArray, v: FloatArray, t: float | None, steps: Any, dt: Any, out: Any
    ) -> tuple[FloatArray, FloatArray]:
        """Do a call of `step`, with float arrays of the shape and type of this state."""
        self.judge.forget_warnings()
        if t is not None or self._moves:
            t = check_start_time(t, self.scenes)
        time = t or 0.0
        steps, dt = self._check_steps(steps, dt, time)
        results = check_or_make_out_arrays(out, self.shape, self.dtype)
        if self._driven:
            check_driven_pins(self.scenes, x, time)
        if self._may_lose_order:
            self.warn_of_order()
        if not (x.flags.c_contiguous and v.flags.c_contiguous):
            x, v = self._check_arrays(x, v)
        events = self.core.step(time, x, v, steps, dt, self.threads, *results)
        if events is False:
            x, v = self._check_arrays(x, v)
            check_depths(self.scenes, x, time)
        if events:
            self._report_and_continue(events, steps, dt)
            self.core.store(*results)
        return results

    def compute_acceleration(self, x: FloatArray, v: FloatArray, t: Any, out: Any) -> FloatArray:
        """Do a call of `acceleration`, with float arrays of the shape and type of this state."""
        core = self._core_of_processor("acceleration needs backend 'cpu'")
        time = check_start_time(t, self.scenes)
        result: FloatArray = np.empty(self.shape) if out is None else out
        check_out_array("out", result, self.shape, np.dtype(np.float64))
        if self._driven:
            check_driven_pins(self.scenes, x, time)
        # Driven pins have the velocity of their motion, and `out` may lie over a part of `x` or
        # `v`.
        contiguous = x.flags.c_contiguous and v.flags.c_contiguous
        direct = out is None and contiguous and not self._driven
        if not (direct and core.accelerations(time, x, v, result, self.threads)):
            self.core.load(*self._check_arrays(x, v), time)
            core.accelerations(result, self.threads)
        return result

    def positions_and_velocities(self) -> tuple[FloatArray, FloatArray]:
        """Return the present positions [m] and velocities [m/s] in double."""
        x = np.empty(self.shape)
        v = np.empty(self.shape)
        self.core.store(x, v)
        return x, v

    def _check_arrays(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the arrays, contiguous.

        Raise a ValueError for numbers that are not finite, or too large for the precision.
        """
        return check_state_arrays(x, v, self.scenes, self.batched, self.options.precision)

    def advance(self, steps: Any, dt: Any) -> None:
        """Advance all members; see `Stepper.advance`."""
        steps, dt = self._check_steps(steps, dt, self.core.time)
        events = self.core.advance(steps, dt, self.threads)
        if events:
            self._report_and_continue(events, steps, dt)

    def warn_of_time_step(self, dt: float) -> None:
        """Give a `StabilityWarning` if a time step is too long, before steps are recorded."""
        self._check_steps(1, dt, self.core.time)

    def record(
        self,
        run: _core.RunInProgress,
        x: list[FloatArray],
        v: list[FloatArray],
        steps: int,
        frames: int,
    ) -> None:
        """Take at most so many steps of a run, and fill at most so many of its frames.

        `x`, `v`: arrays of each member, shape (frames, rows, columns, 3). It ends sooner at a
        warning.
        """
        steps_before = run.steps
        events = self.core.record(run, x, v, steps, frames, self.threads)
        if events:
            self.judge.report_events(events, run.dt, steps_before)

    def _check_steps(self, steps: Any, dt: Any, t: float) -> tuple[int, float]:
        """Return steps and dt as plain numbers; give a `StabilityWarning` if dt is too long. `t`:
        time of the state [s].
        """
        if self._has_layers and dt != self._dt_of_depths:
            self._set_stable_layer_depths(dt)
        # Nearly every call has this form, which takes a tenth of the time of the checks.
        if (
            type(steps) is int
            and type(dt) is float
            and 0 <= steps < 2**62
            and 0.0 < dt <= self.judge.least_stable_dt
        ):
            if t + dt != t:
                return steps, dt
        if isinstance(steps, float) and isinstance(dt, int):
            raise TypeError(
                f"steps must be an integer, got steps={steps!r} and dt={dt!r}, which look "
                "swapped: the order is advance(steps, dt) and step(scene, x, v, dt, steps); "
                "both can be given by name"
            )
        steps = check.integer("steps", steps, minimum=0)
        dt = check.number("dt", dt, minimum=0, exclusive=True)
        if t + dt == t:
            raise ValueError(
                f"dt must be above the rounding of the time t = {t:g} s, {abs(t) * _ROUNDING:.3g} "
                f"s, got {dt!r}: start at a t nearer to 0"
            )
        self.judge.judge_time_step(dt)
        return steps, dt

    def _set_stable_layer_depths(self, dt: Any) -> None:
        """Tell the core from which depths in layers on it warns of a time step."""
        if check.real_or_none(dt) is None or not dt > 0:
            return
        for k, scene in enumerate(self.scenes):
            depths = stable_layer_depths(scene, self.integrator, float(dt))
            self.core.set_stable_layer_depths(k, depths)
        self._dt_of_depths = dt

    def _report_and_continue(
        self, events: Sequence[_core.Event] | None, steps: int, dt: float, steps_before: int = 0
    ) -> None:
        """Report the events of a call, and take the steps that it left where energy has grown.

        `steps_before`: steps of earlier calls, which errors count.
        """
        count = 0
        while events:
            self.judge.report_events(events, dt, steps_before + count)
            ends = [event.step for event in events if event.kind == "grown"]
            if not ends:
                return
            count += ends[0]
            events = self.core.advance(steps - count, dt, self.threads)

    def warn_of_order(self) -> None:
        """Give an `OrderWarning` for the first scene for which the integrator loses order."""
        if self._may_lose_order:
            any(warn_of_order(self.integrator, scene) for scene in self.scenes)

    def replace_state(self, x: Any = None, v: Any = None, t: Any = None) -> None:
        """See `Stepper.set_state`."""
        time = None if t is None else check.number("t", t)
        own_x, own_v = self.positions_and_velocities()
        put_driven_pins(
            self.scenes, own_x, own_v, self.core.time if time is None else time, self.core.frozen
        )
        # The core's own values are of float64, which holds the whole state of "single" too.
        x = own_x if x is None else x
        v = own_v if v is None else v
        new_x, new_v = check_state_arrays(x, v, self.scenes, self.batched, self.options.precision)
        if new_x.shape != self.shape:
            raise ValueError(f"x and v must have shape {self.shape}, got {new_x.shape}")
        check_pins(self.scenes, new_x, new_v, own_x, own_v)
        check_depths(self.scenes, new_x, self.core.time if time is None else time)
        self.core.load(new_x, new_v, time)

    def advance_spheres(
        self, steps: Any, dt: Any, targets: dict[int, npt.NDArray[np.float64]]
    ) -> None:
        """Advance while spheres travel straight to their targets [m]; there they rest."""
        core = self._core_of_processor(
            "centers must be None with backend 'gpu'; backend='cpu' moves spheres by hand"
        )
        begin = core.time
        steps, dt = self._check_steps(steps, dt, begin)
        starts = {k: [scene.spheres[k].center_at(begin) for scene in self.scenes] for k in targets}
        speeds = {}
        motions = {}
        for k, target in targets.items():
            with np.errstate(over="ignore"):
                speeds[k] = [(target - start) / (steps * dt) for start in starts[k]]
            if not np.isfinite(speeds[k]).all():
                raise ValueError(
                    f"centers[{k}] must be reached at a finite speed in {steps} steps of {dt:g} s, "
                    f"got {target.tolist()}"
                )
            motions[k] = [Linear(v).core for v in speeds[k]]
        arrived = False
        with Interrupts() as interrupts:  # the core and its record change together
            try:
                for k in targets:
                    origins = [x - begin * v for x, v in zip(starts[k], speeds[k])]
                    core.set_sphere(k, origins, motions[k])
                self._advance_in_pieces(steps, dt, interrupts)
                arrived = True
            finally:  # where a step has failed, spheres are on their way
                seconds = self.core.time - begin
                scenes = self.scenes
                for k, target in targets.items():
                    ends = [
                        target if arrived else x + seconds * v for x, v in zip(starts[k], speeds[k])
                    ]
                    core.set_sphere(k, ends, [_core.Motion()] * len(ends))
                    scenes = [
                        scene.replace(
                            spheres=[
                                s._copy_at_rest(x) if n == k else s
                                for n, s in enumerate(scene.spheres)
                            ]
                        )
                        for scene, x in zip(scenes, ends)
                    ]
                self._keep_scenes(scenes)

    def _advance_in_pieces(self, steps: int, dt: float, interrupts: Interrupts) -> None:
        """Advance while Ctrl-C is held back, which takes effect between two pieces."""
        total = 0
        piece = 1
        while total < steps:
            count = min(piece, steps - total)
            begin = time.monotonic()
            if events := self.core.advance(count, dt, self.threads):
                self._report_and_continue(events, count, dt, total)
            total += count
            if time.monotonic() - begin < _LONGEST_PIECE / 2:
                piece *= 2
            interrupts.deliver_signal()

    def set_force(self, force: FloatArray) -> None:
        """Set the force on each point [N], float64, of the shape of the state."""
        core = self._core_of_processor(
            "set_force needs backend 'cpu': the compute shader has no force on points"
        )
        members = force if self.batched else force[None]
        scenes = [scene.replace(force=field) for scene, field in zip(self.scenes, members)]
        with Interrupts():  # the core and its record change together
            core.set_force(force)
            self._keep_scenes(scenes)

    def _core_of_processor(self, refusal: str) -> _core.Simulation:
        """Return the core; a ValueError refuses what the adapter does not have."""
        if not isinstance(self.core, _core.Simulation):
            raise ValueError(refusal)
        return self.core

    def _keep_scenes(self, scenes: list[Scene]) -> None:
        """Take over scenes that the core has already."""
        self.scenes[:] = scenes
        single = isinstance(self.scene_of_caller, Scene) and not self.batched
        self.scene_of_caller = scenes[0] if single else list(scenes)
