"""Members of a batch whose scenes have the same features: one set of buffers, one dispatch a stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..plan import core_plan
from ..scene import Scene
from . import parameters
from .device import Device, translated
from .shader import Features, pipelines

GROUP = 16
NONE_BAD = 0xFFFFFFFF
_INTEGERS = 6  # of Constants in layout.wgsl, after its four numbers


class Block:
    """The state of some members on the adapter.

    Parameters
    ----------
    device : Device
    members : sequence of int
        Their places in the batch.
    scenes : sequence of Scene
        One a member, of one shape and equal `Features`.
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
        precision: str,
        strict: bool,
        most_steps: int,
    ) -> None:
        self.device, self.members = device, list(members)
        self.single = precision == "single"
        self.real = np.float32 if self.single else np.float64
        self.wide = np.float64 if device.float64 else np.float32
        shared = all(scene is scenes[0] for scene in scenes)
        self.scenes = [scenes[0]] if shared else list(scenes)
        self.plans = [core_plan(scene) for scene in self.scenes]
        self.rows, self.columns = scenes[0].cloth.shape
        self.points = self.rows * self.columns
        self.features = Features.of(scenes[0])
        self.groups = (math.ceil(self.columns / GROUP), math.ceil(self.rows / GROUP), len(members))
        self._check_limits()
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
                f"scene is too large for the graphics adapter: {what} takes {self.groups} workgroups, "
                f"{adapter.name} has at most {most:,} in each direction"
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
        size = max(1, tables * per_step) * np.dtype(self.wide).itemsize
        self.contacts = create(size, "STORAGE", "COPY_DST")
        self.results = create(4 * (1 + len(self.members)), *both)
        self.constants = create(64, "UNIFORM", "COPY_DST")
        self.readback = create(4 * (1 + len(self.members)), "MAP_READ", "COPY_DST")
        self.checkpoint = [create(b.size, "COPY_SRC", "COPY_DST") for b in self._kept]
        self._integers = np.array(
            [self.rows, self.columns, stride, per_scene if stride else 0, per_step, 0], np.uint32
        )
        assert len(self._integers) == _INTEGERS
        bound = [
            self.constants, self.state, self.compensation, *working, self.parameters, self.contacts,
            self.results,
        ]  # fmt: skip
        with translated(self.device.adapter):
            self.bindings = self.device.handle.create_bind_group(
                layout=self.pipelines.layout,
                entries=[
                    {"binding": k, "resource": {"buffer": buffer}} for k, buffer in enumerate(bound)
                ],
            )

    @property
    def _kept(self) -> list[Any]:
        return [self.state, self.compensation] if self.single else [self.state]

    # Moving the state ---------------------------------------------------------------------------------

    def upload(self, parts: Sequence[np.ndarray]) -> None:
        """Planes of the state, and of the compensation, each (members, 6, points)."""
        for buffer, planes in zip(self._kept, parts, strict=True):
            self._write(buffer, planes)

    def download(self) -> list[np.ndarray]:
        """What `upload` takes."""
        shape = (len(self.members), 6, self.points)
        count = math.prod(shape)
        size = count * np.dtype(self.real).itemsize
        read = self.device.handle.queue.read_buffer
        parts = (np.frombuffer(read(b, 0, size), self.real) for b in self._kept)
        return [part.reshape(shape).copy() for part in parts]

    def _write(self, buffer: Any, values: np.ndarray) -> None:
        self.device.handle.queue.write_buffer(buffer, 0, np.ascontiguousarray(values))

    # Stepping -----------------------------------------------------------------------------------------

    def set_step(self, dt: float) -> None:
        """Take `dt` [s] for the steps from here on."""
        numbers = parameters.step_constants(dt, self.real)
        constants = np.frombuffer(numbers.tobytes() + self._integers.tobytes(), np.uint8)
        self._write(self.constants, constants)
        limits = [plan.runaway_speed(dt) for plan in self.plans]
        pairs = zip(self.scenes, limits, strict=True)
        tables = [parameters.scene_parameters(scene, limit, self.real) for scene, limit in pairs]
        self._write(self.parameters, np.concatenate(tables))
        if self.features.spheres and not self.features.moving:
            self._write_contacts([0.0])

    def begin(self, times: Sequence[float]) -> None:
        """Be ready for steps that end at `times`."""
        if self.features.moving:
            self._write_contacts(times)
        results = np.full(1 + len(self.members), NONE_BAD, np.uint32)
        results[0] = 0
        self._write(self.results, results)

    def _write_contacts(self, times: Sequence[float]) -> None:
        table = parameters.contacts(self.scenes, self.plans, times, self.single, self.wide)
        self._write(self.contacts, table)

    def save(self, encoder: Any) -> None:
        """Copy the state, on the adapter, to where `restore` finds it."""
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

    def check(self, work: Any) -> None:
        """Record the search for bad points."""
        work.set_bind_group(0, self.bindings)
        work.set_pipeline(self.pipelines.check)
        work.dispatch_workgroups(*self.groups)

    def bad(self) -> tuple[int, int] | None:
        """The first member of the batch with a bad point and that point, once `readback` is filled."""
        self.readback.map_sync("READ")
        results = np.frombuffer(self.readback.read_mapped(), np.uint32)[1 : 1 + len(self.members)]
        self.readback.unmap()
        found = np.flatnonzero(results != NONE_BAD)
        return (self.members[found[0]], int(results[found[0]])) if found.size else None
