"""A simulation on the graphics adapter, with the interface of the core's (`_core.Simulation`).

The state is six planes per member, of positions and velocities; in single each is split into two of
float32.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import _core
from ..base.interrupts import Interrupts
from ..engine import backend
from ..engine.options import Options, cached_plan
from ..measure import penetration
from ..methods.bound import stable_layer_depths
from ..model.mesh import GROUP
from ..model.scene import Scene
from ..run.reasons import Reason
from . import device as devices
from .device import Device, translate_errors
from .shader import (
    CONTACT_SIZE,
    FINDINGS,
    FIRST_WEIGHT,
    Features,
    check_scenes,
    pipelines,
    scene_parameters,
)

NONE = 0xFFFFFFFF
# The state is checked after so many steps at most. The exact step of a failure is then found by
# repeating steps.
MOST_STEPS_UNCHECKED = 96
# A submission has so many steps: the adapter works on one while the host records the next.
STEPS_PER_SUBMISSION = 32
# The state is inspected after as many steps as this takes [s], or fewer.
SECONDS_BETWEEN_CHECKS = 0.02
NOT_WATCHED = {"points": 0.0, "triangles": 0.0, "first_contact": math.inf}


class Clock(NamedTuple):
    """Times in s, with the core's bits: that of step k is counted from an origin, so that rounding
    does not add up.
    """

    origin: float
    steps: int = 0
    dt: float = 0.0

    def time_after(self, steps: int) -> float:
        """Return the time [s] so many steps from now."""
        return self.origin + float(self.steps + steps) * self.dt


class Simulation:
    """One cloth, or a batch of cloths of one shape, advanced together on the chosen adapter."""

    def __init__(self, scenes: Sequence[Scene], time: float, precision: str) -> None:
        self.device = devices.open_device()
        self.adapter = self.device.adapter
        self.instruction_set = str(self.adapter)
        self.has_current_kernels = True  # no environment chooses other kernels
        if precision == "double" and not self.device.float64:
            raise ValueError(
                f"precision must be 'single' on the graphics adapter {self.adapter.name}, "
                "whose shaders have no float64, got 'double'"
            )
        check_scenes(scenes)
        self._scenes = list(scenes)
        self._precision = precision
        self._single = precision == "single"
        self._shape = (len(scenes), *scenes[0].cloth.shape, 3)
        self._clock = Clock(time)
        self._stable_dt = [math.inf] * len(scenes)
        self.frozen = [False] * len(scenes)
        self.contacts = [0] * len(scenes)  # responses to mass points so far
        self.evaluations = [0] * len(scenes)  # not counted: a step of rk4 takes four
        self._origins = np.zeros((len(scenes), 3))
        self._normals = list(map(measuring_normals, scenes))
        self._extremes = [dict(NOT_WATCHED) for _ in scenes]
        self._busy = threading.Lock()
        self._steps_unchecked = 1
        # The state in host memory, as `split_planes` gives it; up to date for frozen members.
        self._parts: list[np.ndarray] = []
        self._downloaded = False  # the present state
        self._adapter_state: AdapterState | None = None
        with self._exclusive_access():
            self._make_adapter_state(scenes)

    def _make_adapter_state(self, scenes: Sequence[Scene]) -> None:
        """Make the state of the members that are not frozen; None: all are."""
        members = [member for member, frozen in enumerate(self.frozen) if not frozen]
        chosen = [scenes[member] for member in members]
        origins = self._origins[members]
        normals = [self._normals[member] for member in members]
        self._adapter_state = (
            AdapterState(self.device, members, chosen, origins, normals, self._precision)
            if members
            else None
        )
        self._step_set = 0.0

    def _choose_normals(self, scenes: Sequence[Scene], parts: Sequence[np.ndarray]) -> None:
        """Choose the surface points from which gaps are measured, as the core does."""
        if not self._single:
            self._normals = list(map(measuring_normals, scenes))
            return
        self._normals = [
            np.reshape(
                cached_plan(scene, Options()).normals_towards(
                    middle, origin, self._clock.time_after(0)
                ),
                (-1, 3),
            )
            for scene, middle, origin in zip(
                scenes, mean_positions(parts), self._origins, strict=True
            )
        ]

    def load(self, x: np.ndarray | None, v: np.ndarray | None, time: float | None = None) -> None:
        """Set positions and velocities, shape ([B,] rows, columns, 3), and the time; None leaves a
        value as it is.
        """
        with self._exclusive_access():
            if x is None or v is None:
                own = positions_and_velocities(
                    join_planes(self._downloaded_state(), self._origins), self._shape
                )
                x = own[0] if x is None else x
                v = own[1] if v is None else v
            planes = planes_of_state(x, v, self._scenes)
            origins = self._origins
            if time is not None:
                self._clock = Clock(time)
            if self._single:
                self._origins = origins_of_far_positions(planes[:, :3])
                planes[:, :3] -= self._origins[:, :, None]
            parts = split_planes(planes, self._single)
            normals = self._normals
            self._choose_normals(self._scenes, parts)
            changed = (origins != self._origins).any()
            if changed or any((a != b).any() for a, b in zip(normals, self._normals)):
                self._make_adapter_state(self._scenes)
            self._set_state(parts)

    def step(
        self,
        time: float,
        x: Any,
        v: Any,
        steps: int,
        dt: float,
        threads: int,
        x_out: Any,
        v_out: Any,
    ) -> Any:
        """Take a whole call: a state in, steps, and the state out unless there is an event."""
        self.load(x, v, time)
        events = self.advance(steps, dt, threads)
        if not events:
            self.store(x_out, v_out)
        return events

    def set_scene(self, scenes: Sequence[Scene], stable_dt: Sequence[float]) -> None:
        """Replace the scenes and stable time steps [s]; the state stays, and pinned points stop."""
        with self._exclusive_access():
            check_scenes(scenes)
            parts = self._downloaded_state()
            self._choose_normals(scenes, parts)
            self._make_adapter_state(scenes)
            for part in parts:
                stop_pinned_points(part, scenes)
            self._scenes = list(scenes)
            self._stable_dt = list(stable_dt)
            self.contacts = [0] * len(scenes)
            self._extremes = [dict(NOT_WATCHED) for _ in scenes]
            self._set_state(parts)

    def _set_state(self, parts: list[np.ndarray]) -> None:
        self._parts = parts
        self._downloaded = True
        if self._adapter_state:
            self._adapter_state.upload_state(parts)

    def _downloaded_state(self) -> list[np.ndarray]:
        if self._adapter_state and not self._downloaded:
            self._adapter_state.download_state(self._parts)
        self._downloaded = True
        return self._parts

    def store(self, x: np.ndarray | None, v: np.ndarray | None) -> None:
        """Write positions and velocities into arrays of the shape that `load` takes, or None."""
        with self._exclusive_access():
            planes = join_planes(self._downloaded_state(), self._origins)
            for array, values in zip(
                (x, v), positions_and_velocities(planes, self._shape), strict=True
            ):
                if array is not None:
                    array[...] = values.reshape(array.shape)

    def snapshot(self) -> dict[str, Any]:
        """Return the clock and the whole state, with the fields of the core's; there are no
        impulses and no sums of contacts.
        """
        with self._exclusive_access():
            fields: dict[str, Any] = {}
            for name, part in zip(("", "_low"), self._downloaded_state()):
                fields["positions" + name], fields["velocities" + name] = positions_and_velocities(
                    part.astype(np.float64), self._shape
                )
            clock = self._clock
            fields |= {
                "origins": self._origins.copy(),
                "normals": np.concatenate(self._normals),
                "frozen": np.array(self.frozen),
                "time": clock.time_after(0),
            }
            return fields | {
                "clock_origin": clock.origin,
                "clock_steps": clock.steps,
                "clock_step": clock.dt,
            }

    def restore(self, fields: dict[str, Any]) -> None:
        """Return to the state of `snapshot`."""
        with self._exclusive_access():
            names = ("", "_low") if self._single else ("",)
            parts = [
                planes_of_state(fields["positions" + n], fields["velocities" + n], self._scenes)
                for n in names
            ]
            self.frozen = [bool(frozen) for frozen in fields["frozen"]]
            self._origins = np.array(fields["origins"])
            if self._single:
                ends = np.cumsum([len(scene.spheres) for scene in self._scenes])
                self._normals = np.split(fields["normals"], ends[:-1])
            self._make_adapter_state(self._scenes)
            self._clock = Clock(
                float(fields["clock_origin"]),
                int(fields["clock_steps"]),
                float(fields["clock_step"]),
            )
            self._set_state(
                [part.astype(np.float32 if self._single else np.float64) for part in parts]
            )

    @property
    def time(self) -> float:
        return self._clock.time_after(0)

    @time.setter
    def time(self, time: float) -> None:
        self._clock = Clock(time)

    def set_stable_dt(self, stable_dt: Sequence[float]) -> None:
        """Set each member's stable time step [s]. The core checks speeds only above this step."""
        self._stable_dt = list(stable_dt)
        self._step_set = 0.0

    def set_frozen(self, i: int, frozen: bool) -> None:
        """Exclude a member from further steps, or include it again."""
        with self._exclusive_access():
            parts = self._downloaded_state()
            self.frozen[i] = frozen
            self._make_adapter_state(self._scenes)
            self._set_state(parts)

    def set_stable_layer_depths(self, i: int, depths: list[float]) -> None:
        """Do nothing: `sample` computes from which depths on a time step may be too long."""

    def set_watch(self, every: int, interval: float) -> None:
        """Do nothing: the adapter watches no state between calls, and `watched` says so."""

    def sample(self) -> None:
        """Look at the present state, if no step has."""
        with self._exclusive_access():
            self._measure_depths()

    def _measure_depths(self, steps: int = 0) -> list[_core.Event]:
        """Measure how deep the cloth is in the obstacles; what a user should be told of it, after
        `steps` steps of a call.
        """
        events: dict[str, _core.Event] = {}
        x, _ = positions_and_velocities(
            join_planes(self._downloaded_state(), self._origins), self._shape
        )
        for member, (scene, extremes) in enumerate(zip(self._scenes, self._extremes, strict=True)):
            if self.frozen[member]:
                continue
            plan = cached_plan(scene, Options())
            time = self._clock.time_after(0)
            penetrations = [penetration(x[member], s, time) for s in scene.spheres]
            for name in ("points", "triangles"):
                depth = max((float(depths[name]) for depths in penetrations), default=0.0)
                extremes[name] = max(extremes[name], depth)
            if not self._has_penalty_obstacle(scene):
                continue
            state: dict[str, Any] = {"member": member, "step": steps, "time": time}
            below = max(extremes["points"], extremes["triangles"])
            if below > _core.heuristics["negligible_depth"]:
                events.setdefault("below", _core.Event(kind="below", value=below, **state))
            limits = stable_layer_depths(scene, "rk4", self._clock.dt) if self._clock.dt else []
            depths = _core.contact_depths(plan, np.ascontiguousarray(x[member]), time)
            for k, (limit, (depth, _)) in enumerate(zip(limits, depths)):
                if depth > limit:
                    event = _core.Event(kind="stiff", obstacle=k, value=depth, **state)
                    events.setdefault("stiff", event)
        return list(events.values())

    @staticmethod
    def _has_penalty_obstacle(scene: Scene) -> bool:
        return any(sphere.response == "penalty" for sphere in scene.spheres)

    @property
    def watched(self) -> list[dict[str, Any]]:
        """Extremes per member, with the keys of the core: NaN with a "reason" where the adapter
        does not tell them. Depths are those of the states that have been looked at.
        """
        nan = math.nan
        members = []
        for scene, count, extremes in zip(self._scenes, self.contacts, self._extremes, strict=True):
            responded = count > 0
            first = extremes["first_contact"]
            members.append(
                {
                    **dict.fromkeys(("stretch", "energy_gained"), nan),
                    "point_depth": extremes["points"],
                    "triangle_depth": extremes["triangles"],
                    "first_contact": nan if responded or first == math.inf else first,
                    "responded": responded,
                    "in_contact": responded or first < math.inf,
                    "reason": Reason.NOT_WATCHED,
                    "impulse": [[nan] * 3 for _ in scene.spheres],
                    "obstacle_work": [nan for _ in scene.spheres],
                }
            )
        return members

    def advance(self, steps: int, dt: float, threads: int) -> list[_core.Event]:
        """Take steps and return what a user should know of them, that of a failed step last."""
        with self._exclusive_access(), Interrupts() as interrupts:
            self._downloaded = False
            if dt != self._clock.dt:
                self._clock = Clock(self._clock.time_after(0), 0, dt)
            if dt != self._step_set and self._adapter_state:
                self._adapter_state.set_step(dt, self._stable_dt)
            self._step_set = dt
            self._events: list[_core.Event] = []
            try:
                failures = self._advance_in_pieces(steps, interrupts)
                if any(map(self._has_penalty_obstacle, self._scenes)):
                    self._events += self._measure_depths(steps)
                return self._events + failures
            except Exception:
                if self._adapter_state:
                    self._adapter_state.undo_steps()
                raise

    @property
    def plans(self) -> list[_core.Plan]:
        """The core's form of the scenes, by which it interpolates frames."""
        return [cached_plan(scene, Options()) for scene in self._scenes]

    def record(
        self,
        run: _core.FixedRun,
        x: list[np.ndarray],
        v: list[np.ndarray],
        steps: int,
        frames: int,
        threads: int,
    ) -> list[_core.Event] | None:
        """Take steps and fill frames, as the core's simulation does."""
        return run.record(self, x, v, steps, frames)

    def _advance_in_pieces(self, steps: int, interrupts: Interrupts) -> list[_core.Event]:
        total = 0
        most = MOST_STEPS_UNCHECKED
        while total < steps:
            count = min(self._steps_unchecked, steps - total, most)
            start = time.monotonic()
            if bad := self._try_steps(count):
                if count == 1:
                    kind = "unstable" if bad["obstacle"] < 0 else "passed"
                    time_of_step = self._clock.time_after(1)
                    return [_core.Event(kind=kind, **bad, step=total + 1, time=time_of_step)]
                # Repeated steps give the same bits, so single ones find the one that fails.
                most = 1
                continue
            total += count
            if not self._events and self._adapter_state and self._adapter_state.pinned_inside:
                member, point = self._adapter_state.pinned_inside
                place: dict[str, Any] = {"member": member, "point": point}
                time_of_state = self._clock.time_after(0)
                event = _core.Event(kind="pinned_inside", **place, step=total, time=time_of_state)
                self._events.append(event)
            seconds = max(time.monotonic() - start, 1e-9)
            quick = int(SECONDS_BETWEEN_CHECKS * count / seconds)
            self._steps_unchecked = min(max(1, quick), MOST_STEPS_UNCHECKED)
            interrupts.deliver_signal()
        return []

    def _try_steps(self, steps: int) -> dict[str, Any] | None:
        """Take `steps` steps. If a state is bad, undo them and return what
        `AdapterState.take_steps` found.
        """
        if self._adapter_state:
            if bad := self._adapter_state.take_steps(
                [self._clock.time_after(k) for k in range(steps + 1)]
            ):
                if steps == 1 and bad["obstacle"] >= 0:
                    bad |= self._deepest_point_and_obstacle(bad["member"])
                    self._downloaded = False
                self._adapter_state.undo_steps()
                return bad
            self._adapter_state.uncommitted = False
            counts = self._adapter_state.contacts, self._adapter_state.first
            for member, count, first in zip(self._adapter_state.members, *counts, strict=True):
                self.contacts[member] += int(count)
                extremes = self._extremes[member]
                if first != NONE and extremes["first_contact"] == math.inf:
                    extremes["first_contact"] = self._clock.time_after(int(first))
        self._clock = self._clock._replace(steps=self._clock.steps + steps)
        return None

    def _deepest_point_and_obstacle(self, member: int) -> dict[str, int]:
        """Return the point of a member that is furthest through a layer after a step, and the
        obstacle.
        """
        scene = self._scenes[member]
        x, _ = positions_and_velocities(
            join_planes(self._downloaded_state(), self._origins), (len(self._scenes), -1, 3)
        )
        depths = _core.contact_depths(
            cached_plan(scene, Options()),
            np.ascontiguousarray(x[member]),
            self._clock.time_after(1),
        )

        def thickness_passed_and_depth(k: int) -> tuple[bool, float]:
            depth = depths[k][0]
            return depth > 2 * scene.spheres[k].layer(scene.cloth)["thickness"], depth

        obstacle = max(
            (k for k, (depth, _) in enumerate(depths) if depth > 0), key=thickness_passed_and_depth
        )
        return {"obstacle": obstacle, "point": depths[obstacle][1]}

    @contextmanager
    def _exclusive_access(self) -> Any:
        """Admit one caller at a time, and translate errors of wgpu."""
        self.device.check_process()
        if not self._busy.acquire(blocking=False):
            raise RuntimeError(
                "this state is being advanced by another thread; give each thread a Stepper "
                "of its own"
            )
        try:
            with translate_errors(self.adapter):
                yield
        finally:
            self._busy.release()


if TYPE_CHECKING:  # mypy finds that it does what a state asks of a backend
    _backend: type[backend.Simulation] = Simulation


class AdapterState:
    """The members of a batch with these indices on the adapter. Their scenes have one shape and
    equal `Features`: a dispatch per stage serves all. `origins` are those of their positions [m],
    shape (members, 3), `normals` those of each member's obstacles.
    """

    def __init__(
        self,
        device: Device,
        members: Sequence[int],
        scenes: Sequence[Scene],
        origins: np.ndarray,
        normals: Sequence[np.ndarray],
        precision: str,
    ) -> None:
        self.device = device
        self.members = list(members)
        self.single = precision == "single"
        self.real = np.float32 if self.single else np.float64
        self.wide = np.float64 if device.float64 else np.float32
        shared = all(scene is scenes[0] for scene in scenes) and (origins == origins[0]).all()
        shared &= all((rows == normals[0]).all() for rows in normals)
        self.scenes = [scenes[0]] if shared else list(scenes)
        self.origins = origins[: len(self.scenes)]
        self.normals = normals
        self.plans = [cached_plan(scene, Options()) for scene in self.scenes]
        self.features = Features.of_scene(scenes[0])
        self.pipelines = pipelines(device, self.features, precision)
        rows, columns = scenes[0].cloth.shape
        self.points = rows * columns
        self.groups = math.ceil(columns / GROUP[0]), math.ceil(rows / GROUP[1]), len(members)
        self.uncommitted = False  # steps after the checkpoint can be undone
        self._make_buffers(rows, columns, len(members))

    def _make_buffers(self, rows: int, columns: int, members: int) -> None:
        create = self.device.create_buffer
        adapter = self.device.adapter
        bytes_of_real = np.dtype(self.real).itemsize
        six = 6 * self.points * members * bytes_of_real
        for needed, most, unit in (
            (six, adapter.largest_buffer, "bytes in a buffer"),
            (max(self.groups), self.device.groups_limit, "workgroups in a direction"),
        ):
            if needed > most:
                raise ValueError(
                    f"scene is too large for the graphics adapter: {members} of shape {rows} x "
                    f"{columns} take {needed:,} {unit}, {adapter.name} has at most {most:,}"
                )
        usages = ("STORAGE", "COPY_SRC", "COPY_DST")
        self.state = create(six, *usages)
        self.compensation = create(six if self.single else 16, *usages)
        working = [create(six, "STORAGE") for _ in range(3)]
        per_member = FIRST_WEIGHT + self.points
        self.parameters = create(
            per_member * len(self.scenes) * bytes_of_real, "STORAGE", "COPY_DST"
        )
        per_scene = len(self.features.spheres) * CONTACT_SIZE
        per_step = per_scene * len(self.scenes)
        tables = 1 + MOST_STEPS_UNCHECKED if self.features.moving else 1
        self.contact_table = create(
            (tables * per_step or 1) * np.dtype(self.wide).itemsize, "STORAGE", "COPY_DST"
        )
        self._results = np.zeros(1 + (1 + len(FINDINGS)) * members, np.uint32)
        self._results[1 : 1 + len(FINDINGS) * members] = NONE
        self.results = create(self._results.nbytes, *usages)
        self.constants = create(96, "UNIFORM", "COPY_DST")
        self.readback = create(self._results.nbytes, "MAP_READ", "COPY_DST")
        self.saved_buffers = [self.state, self.compensation][: 1 + self.single]
        self.checkpoint = [
            create(buffer.size, "COPY_SRC", "COPY_DST") for buffer in self.saved_buffers
        ]
        stride = (per_member, per_scene) if len(self.scenes) > 1 else (0, 0)
        self._integers = np.array([rows, columns, *stride, per_step, 0, members], np.uint32)
        bound = [
            self.constants,
            self.state,
            self.compensation,
            *working,
            self.parameters,
            self.contact_table,
            self.results,
        ]
        entries = [{"binding": k, "resource": {"buffer": buffer}} for k, buffer in enumerate(bound)]
        self.bindings = self.device.handle.create_bind_group(
            layout=self.pipelines.layout, entries=entries
        )

    def upload_state(self, parts: Sequence[np.ndarray]) -> None:
        """Upload these members' part of the batch's state, in the form of `split_planes`."""
        for buffer, planes in zip(self.saved_buffers, parts, strict=True):
            self._write_buffer(buffer, planes[self.members])

    def download_state(self, parts: Sequence[np.ndarray]) -> None:
        """Write these members' state into the batch's; the others keep their values."""
        for part, buffer in zip(parts, self.saved_buffers, strict=True):
            values = np.frombuffer(self.device.handle.queue.read_buffer(buffer), self.real)
            part[self.members] = values[: 6 * len(self.members) * self.points].reshape(
                -1, 6, self.points
            )

    def _write_buffer(self, buffer: Any, values: np.ndarray) -> None:
        self.device.handle.queue.write_buffer(buffer, 0, np.ascontiguousarray(values))

    def set_step(self, dt: float, stable_dt: Sequence[float]) -> None:
        """Set the time step `dt` [s]; `stable_dt` has the stable time step of each member."""
        numbers = np.array([dt / 2, dt, dt * dt / 6, dt / 6]).astype(self.real)
        self._write_buffer(
            self.constants, np.frombuffer(numbers.tobytes() + self._integers.tobytes(), np.uint8)
        )
        limits = [
            plan.runaway_speed(dt, stable_dt[member])
            for plan, member in zip(self.plans, self.members)
        ]
        pairs = zip(self.scenes, limits, strict=True)
        self._write_buffer(
            self.parameters,
            np.concatenate([scene_parameters(scene, limit, self.real) for scene, limit in pairs]),
        )
        self._dt = dt
        if self.features.spheres and not self.features.moving:
            self._write_contacts([0.0])

    def _write_contacts(self, times: Sequence[float]) -> None:
        """Write `contacts` (contact.wgsl). `times` are those before the first step and after each;
        a single one where no sphere moves.
        """
        table = np.zeros(
            (len(times), len(self.scenes), len(self.features.spheres), CONTACT_SIZE), self.wide
        )
        penalty = [k for k, s in enumerate(self.features.spheres) if s.response == "penalty"]
        for k, plan in enumerate(self.plans):
            values = plan.contact_table(
                list(times), self.origins[k], self.normals[k], self._dt, self.single
            )
            row = table[:, k]
            row[..., 0:3] = values[..., :3]
            row[..., 3:6] = values[..., :3] - row[..., 0:3]
            row[..., 6:] = values[..., 3:-3]
            row[:, penalty] = values[:, penalty].astype(self.real)
        self._write_buffer(self.contact_table, table)

    def take_steps(self, times: Sequence[float]) -> dict[str, Any] | None:
        """Save a checkpoint and take the steps between `times`. `undo_steps` undoes them.

        Return member of the batch and mass point of the first bad state, and the obstacle through
        whose layer it has gone, or -1; or None.
        """
        if self.features.moving:
            self._write_contacts(times)
        handle = self.device.handle
        steps = len(times) - 1
        self._write_buffer(self.results, self._results)
        encoder = handle.create_command_encoder()
        for buffer, copy in zip(self.saved_buffers, self.checkpoint, strict=True):
            encoder.copy_buffer_to_buffer(buffer, 0, copy, 0, buffer.size)
        for first in range(0, steps, STEPS_PER_SUBMISSION):
            count = min(STEPS_PER_SUBMISSION, steps - first)
            last = first + STEPS_PER_SUBMISSION >= steps
            work = encoder.begin_compute_pass()
            work.set_bind_group(0, self.bindings)
            for stage in [*self.pipelines.stages * count, *[self.pipelines.check] * last]:
                work.set_pipeline(stage)
                work.dispatch_workgroups(*self.groups)
            work.end()
            if last:
                encoder.copy_buffer_to_buffer(
                    self.results, 0, self.readback, 0, self._results.nbytes
                )
            handle.queue.submit([encoder.finish()])
            self.uncommitted = True
            encoder = handle.create_command_encoder()
        return self._read_results()

    def _read_results(self) -> dict[str, Any] | None:
        self.readback.map_sync("READ")
        results = np.array(
            np.frombuffer(self.readback.read_mapped(), np.uint32)[: len(self._results)]
        )
        self.readback.unmap()
        values_of = results[1:].reshape(1 + len(FINDINGS), -1)  # layout.wgsl
        findings = dict(zip(FINDINGS, values_of))
        self.contacts = values_of[-1]
        self.first = findings["first_contact"]
        firsts = {
            name: (self.members[k], int(values[k]))
            for name, values in findings.items()
            for k in np.flatnonzero(values != NONE)[:1]
        }
        self.pinned_inside = firsts.get("pinned_inside")
        for name in ("bad", "passed"):
            if name in firsts:
                member, value = firsts[name]
                obstacle, point = divmod(value, self.points)
                return {
                    "member": member,
                    "point": point,
                    "obstacle": obstacle if name == "passed" else -1,
                }
        return None

    def undo_steps(self) -> None:
        """Return to the checkpoint of `take_steps`, if its steps have not been accepted."""
        if self.uncommitted:
            encoder = self.device.handle.create_command_encoder()
            for buffer, copy in zip(self.saved_buffers, self.checkpoint, strict=True):
                encoder.copy_buffer_to_buffer(copy, 0, buffer, 0, buffer.size)
            self.device.handle.queue.submit([encoder.finish()])
        self.uncommitted = False


def planes_of_state(x: np.ndarray, v: np.ndarray, scenes: Sequence[Scene]) -> np.ndarray:
    """Return positions [m] and velocities [m/s], shape ([B,] rows, columns, 3), as float64 planes
    (members, 6, points).

    Pinned points rest. There is one scene for each member.
    """
    shape = (len(scenes), -1, 3)
    planes = np.concatenate([x.reshape(shape), v.reshape(shape)], axis=2).transpose(0, 2, 1)
    planes = planes.astype(np.float64, order="C")
    stop_pinned_points(planes, scenes)
    return planes


def stop_pinned_points(planes: np.ndarray, scenes: Sequence[Scene]) -> None:
    """Set the velocities of pinned points to 0."""
    for member, scene in enumerate(scenes):
        planes[member, 3:, scene.cloth.pinned.ravel()] = 0


def origins_of_far_positions(positions: np.ndarray) -> np.ndarray:
    """Return origins, shape (members, 3), of positions in single, shape (members, 3, points) [m].

    An origin is 0, except for a cloth that is far away for its size.
    """
    low = positions.min(axis=2)
    high = positions.max(axis=2)
    middle = low / 2 + high / 2
    distance = np.linalg.norm(middle, axis=1)
    far = distance > _core.heuristics["extents_that_are_far"] * np.linalg.norm(high - low, axis=1)
    far &= distance < np.finfo(np.float32).max
    return np.where(far[:, None], middle, 0.0)


def split_planes(planes: np.ndarray, single: bool) -> list[np.ndarray]:
    """Split float64 planes into parts to upload: the state, and in single also its compensation."""
    if not single:
        return [planes]
    high = planes.astype(np.float32)
    return [high, (planes - high).astype(np.float32)]


def measuring_normals(scene: Scene) -> np.ndarray:
    """Return normals of the obstacles of a scene, shape (obstacles, 3)."""
    return np.reshape([sphere.normal for sphere in scene.core_spheres], (-1, 3))


def mean_positions(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return mean positions of the parts of states in single, shape (members, 3), summed point by
    point as in the core.
    """
    x = parts[0][:, :3].astype(np.float64) + parts[1][:, :3]
    return np.asarray(np.cumsum(x, axis=2)[..., -1] / x.shape[2])


def join_planes(parts: Sequence[np.ndarray], origins: np.ndarray) -> np.ndarray:
    """Return the parts as float64 planes in the scene's coordinates, shape (members, 6, points)."""
    planes = parts[0].astype(np.float64)
    for part in parts[1:]:
        planes += part
    origins = origins[:, :, None]
    positions = planes[:, :3]
    np.add(positions, origins, out=positions, where=origins != 0)  # -0 stays -0
    return planes


def positions_and_velocities(planes: np.ndarray, shape: tuple[int, ...]) -> list[np.ndarray]:
    """Return planes (members, 6, points) as positions and velocities of `shape`."""
    return [half.swapaxes(1, 2).reshape(shape) for half in (planes[:, :3], planes[:, 3:])]
