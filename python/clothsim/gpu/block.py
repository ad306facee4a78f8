"""The members of a batch on the adapter. One dispatch per stage serves all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..engine.options import Options
from ..engine.plan import core_plan
from ..model.mesh import GROUP
from ..model.scene import Scene
from . import parameters
from .device import Device, translated
from .shader import Features, pipelines

NONE = 0xFFFFFFFF
# Steps between two checks of the state, at most. The exact step of a failure is then found by repeating steps.
MOST_STEPS_UNCHECKED = 96
# Rounds of `raise` a step, at most; each leaves at most 0.71 of the last move (cpp/contact/contact_pass.hpp).
MOST_ROUNDS = 127
# Runs after which a step gets fewer rounds. Half tries again more often, twice keeps rounds that nothing needs for longer.
RUNS_WITH_EQUAL_ROUNDS = 16
# Steps a submission: the adapter works on one while the host records the next.
STEPS_PER_SUBMISSION = 32


def workgroups(shape: tuple[int, int], members: int = 1) -> tuple[int, int, int]:
    """Workgroups of a dispatch over cloths of `shape`, along columns, rows and members."""
    return math.ceil(shape[1] / GROUP[0]), math.ceil(shape[0] / GROUP[1]), members


class Block:
    """The state of some members on the adapter.

    `members` are their indices in the batch. Their scenes have one shape and equal `Features`. `origins` are those of their
    positions [m], shape (members, 3).
    """

    def __init__(
        self, device: Device, members: Sequence[int], scenes: Sequence[Scene], origins: np.ndarray, precision: str
    ) -> None:
        self.device, self.members = device, list(members)
        self.single = precision == "single"
        self.real = np.float32 if self.single else np.float64
        self.wide = np.float64 if device.float64 else np.float32
        shared = all(scene is scenes[0] for scene in scenes) and (origins == origins[0]).all()
        self.scenes = [scenes[0]] if shared else list(scenes)
        self.origins = origins[: len(self.scenes)]
        self.contacts = np.zeros(len(members), np.int64)  # responses since the last `run` began
        self.found: dict[str, tuple[int, int]] = {}  # member and point of a finding in it
        self.plans = [core_plan(scene, Options()) for scene in self.scenes]
        self.rows, self.columns = scenes[0].cloth.shape
        self.points = self.rows * self.columns
        self.features = Features.of(scenes[0])
        self.groups = workgroups(scenes[0].cloth.shape, len(members))
        self._ahead = False
        self._rounds, self._runs, self._settled = 1, 0, True
        self._plane_bytes = self.points * len(members) * np.dtype(self.real).itemsize
        self._check_limits()
        self.pipelines = pipelines(device, self.features, precision)
        self._make_buffers()

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

    def _make_buffers(self) -> None:
        create = self.device.create_buffer
        six = 6 * self._plane_bytes
        both = ("STORAGE", "COPY_SRC", "COPY_DST")
        self.state = create(six, *both)
        self.compensation = create(six if self.single else 16, *both)
        working = [create(six, "STORAGE") for _ in range(3)]
        one = parameters.FIRST_WEIGHT + self.points
        size = one * len(self.scenes) * np.dtype(self.real).itemsize
        self.parameters = create(size, "STORAGE", "COPY_DST")
        per_scene = len(self.features.spheres) * parameters.CONTACT_SIZE
        per_step = per_scene * len(self.scenes)
        tables = 1 + MOST_STEPS_UNCHECKED if self.features.moving else 1
        self.contact_table = create((tables * per_step or 1) * np.dtype(self.wide).itemsize, "STORAGE", "COPY_DST")
        self._results = np.zeros(2 + 4 * len(self.members), np.uint32)
        self._results[1 : 1 + 3 * len(self.members)] = NONE
        self.results = create(self._results.nbytes, *both)
        self.constants = create(96, "UNIFORM", "COPY_DST")
        self.readback = create(self._results.nbytes, "MAP_READ", "COPY_DST")
        self.checkpoint = [create(b.size, "COPY_SRC", "COPY_DST") for b in self._kept]
        stride = (one, per_scene) if len(self.scenes) > 1 else (0, 0)
        self._integers = np.array([self.rows, self.columns, *stride, per_step, 0, len(self.members)], np.uint32)
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
        """Upload the state of these members out of the whole batch, in the form of `planes.split`."""
        for buffer, planes in zip(self._kept, parts, strict=True):
            self._write(buffer, planes[self.members])

    def download(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The state of the whole batch; members outside the block keep their values of `parts`."""
        parts = [part.copy() for part in parts]
        shape = (len(self.members), 6, self.points)
        size = math.prod(shape) * np.dtype(self.real).itemsize
        for part, buffer in zip(parts, self._kept, strict=True):
            values = np.frombuffer(self.device.handle.queue.read_buffer(buffer, 0, size), self.real)
            part[self.members] = values.reshape(shape)
        return parts

    def _write(self, buffer: Any, values: np.ndarray) -> None:
        self.device.handle.queue.write_buffer(buffer, 0, np.ascontiguousarray(values))

    # Stepping -------------------------------------------------------------------------------------

    def set_step(self, dt: float, stable_dt: Sequence[float]) -> None:
        """Set the time step `dt` [s]; `stable_dt` has the guaranteed step of each member of the batch."""
        numbers = parameters.step_constants(dt, self.real)
        constants = np.frombuffer(numbers.tobytes() + self._integers.tobytes(), np.uint8)
        self._write(self.constants, constants)
        limits = [plan.runaway_speed(dt, stable_dt[member]) for plan, member in zip(self.plans, self.members)]
        pairs = zip(self.scenes, limits, strict=True)
        tables = [parameters.scene_parameters(scene, limit, self.real) for scene, limit in pairs]
        self._write(self.parameters, np.concatenate(tables))
        self._dt = dt
        if self.features.spheres and not self.features.moving:
            self._write_contacts([0.0])

    def _write_contacts(self, times: Sequence[float]) -> None:
        scenes, single = self.scenes, self.single
        table = parameters.contacts(scenes, self.plans, self.origins, times, self._dt, single, self.wide)
        self._write(self.contact_table, table)

    def run(self, times: Sequence[float]) -> tuple[int, int] | None:
        """Save a checkpoint and take the steps between `times`. `accept` keeps them, and `take_back` undoes them.

        Return member of the batch and mass point of the first bad state, or None.
        """
        if self.features.moving:
            self._write_contacts(times)
        bad = self._run(len(times) - 1)
        self._runs += 1
        while not self._settled and self._rounds < MOST_ROUNDS:
            self.take_back()
            self._rounds, self._runs = 2 * self._rounds + 1, 0
            bad = self._run(len(times) - 1)
        if self._runs == RUNS_WITH_EQUAL_ROUNDS:
            self._rounds, self._runs = max(1, self._rounds // 2), 0
        return bad

    def _run(self, steps: int) -> tuple[int, int] | None:
        handle = self.device.handle
        self._write(self.results, self._results)
        encoder = handle.create_command_encoder()
        for buffer, copy in zip(self._kept, self.checkpoint, strict=True):
            encoder.copy_buffer_to_buffer(buffer, 0, copy, 0, buffer.size)
        for first in range(0, steps, STEPS_PER_SUBMISSION):
            count = min(STEPS_PER_SUBMISSION, steps - first)
            last = first + count == steps
            self._record(encoder, count, last)
            if not last:
                handle.queue.submit([encoder.finish()])
                self._ahead = True
                encoder = handle.create_command_encoder()
        encoder.copy_buffer_to_buffer(self.results, 0, self.readback, 0, self._results.nbytes)
        handle.queue.submit([encoder.finish()])
        self._ahead = True
        return self.bad_point()

    def _record(self, encoder: Any, steps: int, check: bool) -> None:
        """Record `steps` steps, and the search for bad points if `check`."""
        work = encoder.begin_compute_pass()
        work.set_bind_group(0, self.bindings)
        stages, rounds = self.pipelines.stages, self.pipelines.rounds
        step = [*stages, *rounds[:2] * (self._rounds // 2), *rounds[2:]]
        for stage in [*step * steps, *[self.pipelines.check] * check]:
            work.set_pipeline(stage)
            work.dispatch_workgroups(*self.groups)
        work.end()

    def bad_point(self) -> tuple[int, int] | None:
        """Read the results of the last steps: the first member with a bad point, and the point."""
        self.readback.map_sync("READ")
        results = np.frombuffer(self.readback.read_mapped(), np.uint32)
        self.readback.unmap()
        self._settled = not results[len(self._results) - 1]
        bad, pinned, capped, contacts = results[1 : len(self._results) - 1].reshape(4, -1)
        self.contacts = contacts.astype(np.int64)
        found = {name: self._first(points) for name, points in (("pinned_inside", pinned), ("large_cell", capped))}
        self.found = {name: one for name, one in found.items() if one}
        return self._first(bad)

    def _first(self, points: np.ndarray) -> tuple[int, int] | None:
        """The first member with a point, and the point."""
        for k in np.flatnonzero(points != NONE)[:1]:
            return self.members[k], int(points[k])
        return None

    def take_back(self) -> None:
        """Return to the checkpoint of `run`, unless its steps were accepted."""
        if not self._ahead:
            return
        encoder = self.device.handle.create_command_encoder()
        for buffer, copy in zip(self._kept, self.checkpoint, strict=True):
            encoder.copy_buffer_to_buffer(copy, 0, buffer, 0, buffer.size)
        self.device.handle.queue.submit([encoder.finish()])
        self._ahead = False

    def accept(self, contacts: list[int]) -> None:
        """Keep the steps of the last `run`, and add their contact responses to the count of each member."""
        self._ahead = False
        for member, count in zip(self.members, self.contacts, strict=True):
            contacts[member] += int(count)
