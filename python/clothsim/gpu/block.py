"""Members of a batch whose scenes have equal features. One dispatch per stage serves all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..engine.options import Options
from ..engine.plan import core_plan, in_cells
from ..model.mesh import GROUP
from ..model.scene import Scene
from . import parameters
from .device import Device, translated
from .shader import RESPONSES, Features, pipelines

NONE_BAD = 0xFFFFFFFF
_BAD, _PINNED_INSIDE, _TRAPPED, _CONTACTS = range(4)  # what `results` tells of a member


def workgroups(shape: tuple[int, int], members: int = 1) -> tuple[int, int, int]:
    """Workgroups of a dispatch over cloths of `shape`, along columns, rows and members."""
    return math.ceil(shape[1] / GROUP[0]), math.ceil(shape[0] / GROUP[1]), members


class Block:
    """The state of some members on the adapter.

    Parameters
    ----------
    device : Device
    members : sequence of int
        Indices of the members in the batch.
    scenes : sequence of Scene
        The scene of each member; all have one shape and equal `Features`.
    origins : numpy.ndarray
        Origin of each member's positions [m], shape (members, 3).
    precision : {"single", "double"}
    strict : bool
    most_steps : int
        Most steps between two calls of `begin`.
    """

    def __init__(
        self,
        device: Device,
        members: Sequence[int],
        scenes: Sequence[Scene],
        origins: np.ndarray,
        precision: str,
        strict: bool,
        most_steps: int,
    ) -> None:
        self.device, self.members = device, list(members)
        self.single = precision == "single"
        self.real = np.float32 if self.single else np.float64
        self.wide = np.float64 if device.float64 else np.float32
        shared = all(scene is scenes[0] for scene in scenes) and (origins == origins[0]).all()
        self.scenes = [scenes[0]] if shared else list(scenes)
        self.origins = origins[: len(self.scenes)]
        self.contacts = np.zeros(len(members), np.int64)  # answered since `begin`, once told
        self.plans = [core_plan(scene, Options()) for scene in self.scenes]
        self.rows, self.columns = scenes[0].cloth.shape
        self.points = self.rows * self.columns
        self.features = Features.of(scenes[0])
        self.groups = workgroups(scenes[0].cloth.shape, len(members))
        self._check_limits()
        self._check_responses()
        self.pipelines = pipelines(device, self.features, precision, strict)
        self._make_buffers(most_steps)

    def _check_limits(self) -> None:
        adapter, cloth = self.device.adapter, self.scenes[0].cloth
        what = f"{len(self.members)} cloth{'s' * (len(self.members) > 1)} of shape {cloth.shape}"
        needed = self._plane_bytes * 6
        if needed > adapter.largest_buffer:
            raise ValueError(
                f"scene is too large for the graphics adapter: {what} "
                f"{'need' if len(self.members) > 1 else 'needs'} buffers of {needed:,} bytes, "
                f"{adapter.name} has at most {adapter.largest_buffer:,}"
            )
        most = self.device.groups_limit
        if max(self.groups) > most:
            raise ValueError(
                f"scene is too large for the graphics adapter: {what} takes {self.groups} "
                f"workgroups, {adapter.name} has at most {most:,} in each direction"
            )

    def _check_responses(self) -> None:
        for scene in self.scenes:
            if scene.cloth.driven:
                pin = next(iter(scene.cloth.driven))
                raise ValueError(f"pins[{pin}] must be None with backend 'gpu', got a motion; backend='cpu' drives pins")
            if scene.force is not None:
                raise ValueError("force must be None with backend 'gpu', got an array; backend='cpu' has it")
            for k, sphere in enumerate(scene.spheres):
                if sphere.response not in RESPONSES:
                    raise ValueError(
                        f"response of spheres[{k}] must be one of {RESPONSES} with backend 'gpu', got {sphere.response!r}; "
                        "backend='cpu' has it"
                    )
                if (sphere.offset == "face" or in_cells(sphere)) and self.wide == np.float64:
                    raise ValueError(
                        f"offset of spheres[{k}] must be 'edge', 'none' or a length on the graphics "
                        f"adapter {self.device.adapter.name}, got {sphere.offset!r}; backend='cpu' has it"
                    )
                if sphere.response == "continuous" and self.wide != np.float64:
                    raise ValueError(
                        f"response of spheres[{k}] must be 'reflect' or 'ray' on the graphics "
                        f"adapter {self.device.adapter.name}, whose shaders have no float64, got "
                        "'continuous'"
                    )

    @property
    def _plane_bytes(self) -> int:
        return self.points * len(self.members) * np.dtype(self.real).itemsize

    def _make_buffers(self, most_steps: int) -> None:
        create = self.device.create_buffer
        six = 6 * self._plane_bytes
        both = ("STORAGE", "COPY_SRC", "COPY_DST")
        self.state = create(six, *both)
        self.compensation = create(six if self.single else 16, *both)
        working = [create(six, "STORAGE") for _ in range(3)]
        one = parameters.FIRST_WEIGHT + self.points
        stride = one if len(self.scenes) > 1 else 0
        size = one * len(self.scenes) * np.dtype(self.real).itemsize
        self.parameters = create(size, "STORAGE", "COPY_DST")
        per_scene = len(self.features.spheres) * parameters.CONTACT_SIZE
        per_step = per_scene * len(self.scenes)
        tables = most_steps if self.features.moving else 1
        self._energies = np.empty((0, 0), self.wide)
        if self.features.continuous:
            self._energies = np.stack([parameters.energies(scene) for scene in self.scenes])
        size = (self._energies.size + tables * per_step or 1) * np.dtype(self.wide).itemsize
        self.contact_table = create(size, "STORAGE", "COPY_DST")
        self._told = 1 + 4 * len(self.members)
        words = math.ceil(self.points / 32) if self.features.continuous else 0
        self._results = np.zeros(self._told + words * len(self.members), np.uint32)
        self._results[1 : 1 + _CONTACTS * len(self.members)] = NONE_BAD
        self.results = create(self._results.nbytes, *both)
        self.constants = create(96, "UNIFORM", "COPY_DST")
        self.readback = create(4 * self._told, "MAP_READ", "COPY_DST")
        self.checkpoint = [create(b.size, "COPY_SRC", "COPY_DST") for b in self._kept]
        energy_stride = self._energies.shape[1] if stride else 0
        self._integers = np.array(
            [
                self.rows,
                self.columns,
                stride,
                per_scene if stride else 0,
                per_step,
                0,
                len(self.members),
                energy_stride,
                self._energies.size,
            ],
            np.uint32,
        )
        bound = [self.constants, self.state, self.compensation, *working, self.parameters, self.contact_table, self.results]
        with translated(self.device.adapter):
            self.bindings = self.device.handle.create_bind_group(
                layout=self.pipelines.layout,
                entries=[{"binding": k, "resource": {"buffer": buffer}} for k, buffer in enumerate(bound)],
            )

    @property
    def _kept(self) -> list[Any]:
        return [self.state, self.compensation] if self.single else [self.state]

    # Moving the state -----------------------------------------------------------------------------

    def upload(self, parts: Sequence[np.ndarray]) -> None:
        """Planes of the state, and of the compensation, each (members, 6, points)."""
        for buffer, planes in zip(self._kept, parts, strict=True):
            self._write(buffer, planes)

    def download(self) -> list[np.ndarray]:
        """Arrays for `upload`."""
        shape = (len(self.members), 6, self.points)
        count = math.prod(shape)
        size = count * np.dtype(self.real).itemsize
        read = self.device.handle.queue.read_buffer
        parts = (np.frombuffer(read(b, 0, size), self.real) for b in self._kept)
        return [part.reshape(shape).copy() for part in parts]

    def _write(self, buffer: Any, values: np.ndarray, offset: int = 0) -> None:
        self.device.handle.queue.write_buffer(buffer, offset, np.ascontiguousarray(values))

    # Stepping -------------------------------------------------------------------------------------

    def set_step(self, dt: float, stable_dt: Sequence[float]) -> None:
        """Set the time step `dt` [s]; `stable_dt` has the guaranteed step of each member."""
        numbers = parameters.step_constants(dt, self.real)
        constants = np.frombuffer(numbers.tobytes() + self._integers.tobytes(), np.uint8)
        self._write(self.constants, constants)
        limits = [plan.runaway_speed(dt, most) for plan, most in zip(self.plans, stable_dt)]
        pairs = zip(self.scenes, limits, strict=True)
        tables = [parameters.scene_parameters(scene, limit, self.real) for scene, limit in pairs]
        self._write(self.parameters, np.concatenate(tables))
        self._dt = dt
        if self.features.continuous:
            self._write(self.contact_table, self._energies)
        if self.features.spheres and not self.features.moving:
            self._write_contacts([0.0, 0.0])

    def begin(self, times: Sequence[float]) -> None:
        """Prepare the steps between `times`."""
        if self.features.moving:
            self._write_contacts(times)
        self._write(self.results, self._results)

    def _write_contacts(self, times: Sequence[float]) -> None:
        table = parameters.contacts(self.scenes, self.plans, self.origins, times, self._dt, self.single, self.wide)
        self._write(self.contact_table, table, self._energies.nbytes)

    def save(self, encoder: Any) -> None:
        """Copy the state, on the adapter, to the buffers that `restore` reads."""
        for buffer, copy in zip(self._kept, self.checkpoint, strict=True):
            encoder.copy_buffer_to_buffer(buffer, 0, copy, 0, buffer.size)

    def restore(self, encoder: Any) -> None:
        for buffer, copy in zip(self._kept, self.checkpoint, strict=True):
            encoder.copy_buffer_to_buffer(copy, 0, buffer, 0, buffer.size)

    def dispatch(self, work: Any, steps: int) -> None:
        """Record `steps` steps into a compute pass."""
        work.set_bind_group(0, self.bindings)
        for _ in range(steps):
            for stage in self.pipelines.stages:
                work.set_pipeline(stage)
                work.dispatch_workgroups(*self.groups)
            if self.pipelines.settle:
                work.set_pipeline(self.pipelines.settle)
                work.dispatch_workgroups(1, 1, self.groups[2])

    def check(self, work: Any) -> None:
        """Record the search for bad points."""
        work.set_bind_group(0, self.bindings)
        work.set_pipeline(self.pipelines.check)
        work.dispatch_workgroups(*self.groups)

    def copy_results(self, encoder: Any) -> None:
        encoder.copy_buffer_to_buffer(self.results, 0, self.readback, 0, 4 * self._told)

    def told(self) -> tuple[dict[str, Any] | None, tuple[int, int] | None]:
        """The first member with a bad point, and the first member with a sphere in a pinned point, each with its point.
        Valid once the results are copied.
        """
        self.readback.map_sync("READ")
        results = np.frombuffer(self.readback.read_mapped(), np.uint32)[1 : self._told]
        self.readback.unmap()
        tables = results.reshape(4, len(self.members))
        self.contacts = tables[_CONTACTS].astype(np.int64)
        bad = None
        trouble = np.minimum(tables[_BAD], tables[_TRAPPED])
        for k in np.flatnonzero(trouble != NONE_BAD)[:1]:
            trapped = bool(tables[_BAD, k] == NONE_BAD)
            point = tables[_TRAPPED if trapped else _BAD, k]
            bad = {"member": self.members[k], "point": int(point), "trapped": trapped}
        pinned = None
        for k in np.flatnonzero(tables[_PINNED_INSIDE] != NONE_BAD)[:1]:
            pinned = self.members[k], int(tables[_PINNED_INSIDE, k])
        return bad, pinned
