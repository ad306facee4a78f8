"""A simulation on the graphics adapter, with the interface of the core's (`_core.Simulation`)."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..scene import Scene
from . import device as devices
from .block import Block
from .clock import Clock
from .device import AdapterLostError, Device, translated
from .interrupts import Interrupts
from .shader import Features
from .watch import STEPS_BETWEEN_ENERGIES, EnergyWatch

# Steps after which the state is looked at, at most; the exact step of a failure is then found by
# going back.
MOST_STEPS_UNCHECKED = 96
# Steps a submission: the adapter works on one while the host records the next.
STEPS_PER_SUBMISSION = 32
SECONDS_BETWEEN_CHECKS = 0.02

# The state is copied back this often in case the adapter is lost, as long as that takes no more
# than this part of the time.
SECONDS_BETWEEN_COPIES = 1.0
PART_OF_TIME_FOR_COPIES = 0.02

# Extents of a cloth from the origin to its middle, from which on single keeps positions relative to
# there, as in the core.
EXTENTS_THAT_ARE_FAR = 8


class Simulation:
    """One cloth, or a batch of cloths of one shape, advanced together on the adapter.

    Parameters
    ----------
    scenes : sequence of Scene
        One a member, of one shape.
    time : float
        Time of the state [s].
    precision : {"double", "single"}
    strict : bool
    device : Device, optional
        Default: that of the chosen adapter.

    Raises
    ------
    ValueError
        If the adapter has no float64 for "double", or a limit of it is exceeded.
    MemoryError, RuntimeError, ImportError
        If its memory does not suffice, there is no adapter, or no wgpu.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        time: float,
        precision: str,
        strict: bool,
        device: Device | None = None,
    ) -> None:
        self.device = device or devices.opened()
        self.adapter = self.device.adapter
        if precision == "double" and not self.device.float64:
            raise ValueError(
                f"precision must be 'single' on the graphics adapter {self.adapter.name}, "
                "whose shaders have no float64, got 'double'"
            )
        self._scenes = list(scenes)
        self._precision, self._strict = precision, strict
        self._single = precision == "single"
        self._members = len(self._scenes)
        self._clock = Clock(time)
        self._stable_dt = [math.inf] * self._members
        self._frozen = [False] * self._members
        self._contacts = [0] * self._members
        self._watches: dict[int, EnergyWatch] = {}
        self._origins = np.zeros((self._members, 3))
        self._make_blocks()
        self._busy = threading.Lock()
        self._steps_unchecked = 1
        self._lost = False

    def _make_blocks(self) -> None:
        alike: dict[Features, list[int]] = {}
        for member, scene in enumerate(self._scenes):
            if not self._frozen[member]:
                alike.setdefault(Features.of(scene), []).append(member)
        self._blocks: list[Block] = []  # frees the memory of those that there are
        for members in alike.values():
            scenes = [self._scenes[m] for m in members]
            block = Block(
                self.device, members, scenes, self._origins[members], self._precision,
                self._strict, MOST_STEPS_UNCHECKED,
            )  # fmt: skip
            self._blocks.append(block)
        self._step_set = 0.0

    # State in and out -----------------------------------------------------------------------------

    def load(self, x: np.ndarray, v: np.ndarray) -> None:
        """Take positions and velocities, shape ([B,] rows, columns, 3); pinned ones rest."""
        with self._used():
            real = np.float32 if self._single else np.float64
            planes = self._planes(x, v)
            self._set_origins(self._far_origins(planes[:, :3]))
            planes[:, :3] -= self._origins[:, :, None]
            whole = planes.astype(real)
            parts = [whole, (planes - whole).astype(real)] if self._single else [whole]
            self._upload(parts)

    def _planes(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        shape = (self._members, -1, 3)
        planes = np.concatenate([x.reshape(shape), v.reshape(shape)], axis=2).transpose(0, 2, 1)
        planes = planes.astype(np.float64, order="C")
        for member, scene in enumerate(self._scenes):
            planes[member, 3:, scene.cloth.pinned.ravel()] = 0
        return planes

    def _far_origins(self, positions: np.ndarray) -> np.ndarray:
        """What positions are kept relative to in single: 0 but for a cloth far off for its size."""
        origins = np.zeros((self._members, 3))
        if self._single:
            low, high = positions.min(axis=2), positions.max(axis=2)
            middle = low / 2 + high / 2
            distance = np.linalg.norm(middle, axis=1)
            far = distance > EXTENTS_THAT_ARE_FAR * np.linalg.norm(high - low, axis=1)
            far &= distance < np.finfo(np.float32).max
            origins[far] = middle[far]
        return origins

    def _set_origins(self, origins: np.ndarray) -> None:
        if (origins != self._origins).any():
            self._origins = origins
            self._make_blocks()

    def _upload(self, parts: Sequence[np.ndarray]) -> None:
        for watch in self._watches.values():
            watch.restart()
        self._put(parts)

    def _put(self, parts: Sequence[np.ndarray]) -> None:
        self._saved = ([np.array(part) for part in parts], self._clock)
        self._saved_at, self._saving_took = time.monotonic(), 0.0
        for block in self._blocks:
            block.upload([part[block.members] for part in parts])

    def _save(self) -> None:
        """Copy the state back, so that it outlives the adapter."""
        start = time.monotonic()
        self._saved = (self._downloaded(), self._clock)
        self._saved_at = time.monotonic()
        self._saving_took = self._saved_at - start

    def _downloaded(self) -> list[np.ndarray]:
        parts = [part.copy() for part in self._saved[0]]  # of frozen members nothing comes back
        for block in self._blocks:
            for part, values in zip(parts, block.download(), strict=True):
                part[block.members] = values
        return parts

    def _state(self) -> list[np.ndarray]:
        """The state, or what is safe of it once the adapter is lost."""
        if not self._lost:
            self._save()
        return self._saved[0]

    def store(self, x: np.ndarray, v: np.ndarray) -> None:
        """Write positions and velocities into arrays of the shape that `load` takes."""
        with self._used():
            whole = self._values(self._state())
            for array, planes in ((x, whole[:, :3]), (v, whole[:, 3:])):
                array[...] = planes.transpose(0, 2, 1).reshape(array.shape)

    def _values(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """The state in float64 and in the scene's coordinates, shape (members, 6, points)."""
        whole = parts[0].astype(np.float64)
        if self._single:
            whole += parts[1]
        origins = self._origins[:, :, None]
        positions = whole[:, :3]
        np.add(positions, origins, out=positions, where=origins != 0)  # -0 stays -0
        return whole

    def snapshot(self) -> tuple[Any, ...]:
        """The clock and the whole state, in the form of the core's."""
        with self._used():
            parts = self._state()
            rows = [part.reshape(self._members, -1) for part in parts]
            raw = np.concatenate([*rows, self._origins], axis=1)
            clock = self._saved[1]
            members = [(row, 0.0) for row in raw.astype(np.float64)]
            return clock.origin, clock.steps, clock.dt, members

    def restore(self, origin: float, steps: int, dt: float, members: Any) -> None:
        """Stand where `snapshot` was taken."""
        with self._used():
            raw = np.array([values for values, _ in members])
            shape = (self._members, 2 if self._single else 1, 6, -1)
            self._set_origins(raw[:, -3:].copy())
            parts = raw[:, :-3].reshape(shape).astype(self._saved[0][0].dtype)
            self._clock = Clock(origin, steps, dt)
            self._upload([np.ascontiguousarray(parts[:, k]) for k in range(shape[1])])

    @property
    def time(self) -> float:
        return (self._saved[1] if self._lost else self._clock).now()

    # The rest of the core's interface -------------------------------------------------------------

    def set_track_contact_energy(self, on: bool) -> None:
        if on:
            raise ValueError(
                "track_contact_energy must be False with backend 'gpu': the energy of a contact is "
                "counted one point after the other, which is what backend 'cpu' does"
            )

    def set_stable_dt(self, stable_dt: Sequence[float]) -> None:
        """The guaranteed time step of each member [s]: only above it a point can be too fast."""
        self._stable_dt, self._step_set = list(stable_dt), 0.0

    def set_frozen(self, member: int, frozen: bool) -> None:
        """Take a member out of further steps, or in again."""
        with self._used():
            parts = self._state()
            self._frozen[member] = frozen
            if not self._lost:
                self._make_blocks()
                self._put(parts)

    @property
    def frozen(self) -> list[bool]:
        return list(self._frozen)

    @property
    def contacts(self) -> list[int]:
        """Answers of the spheres to mass points so far; those of "continuous" are not counted."""
        return list(self._contacts)

    # Stepping -------------------------------------------------------------------------------------

    def advance(self, steps: int, dt: float, threads: int, optional: bool) -> dict[str, Any]:
        """As the core's: steps done, and which point has gone bad if one has."""
        with self._used(), Interrupts() as interrupts:
            self._need_adapter()
            self._set_step(dt)
            self._pinned_inside: tuple[int, int] | None = None
            outcome = self._advance_all(steps, interrupts)
            if self._pinned_inside:
                outcome["pinned_inside"] = self._pinned_inside
            return outcome

    def _advance_all(self, steps: int, interrupts: Interrupts) -> dict[str, Any]:
        done = 0
        self._watched = self._above_stable_dt()
        if self._watched and steps > 0:
            self._runaway()  # notes the energies to begin with
        while done < steps:
            count = min(self._steps_unchecked, steps - done)
            if self._watched:  # at the same steps whatever the clock on the wall says
                count = STEPS_BETWEEN_ENERGIES - self._clock.steps % STEPS_BETWEEN_ENERGIES
                count = min(count, steps - done)
            start = time.monotonic()
            if self._advance(count):
                found = self._rewind_to_last_good(count)
                return {**found, "step": done + found["step"], "steps": done + found["step"] - 1}
            self._count_contacts()
            self._clock = self._clock.after(count)
            done += count
            seconds = time.monotonic() - start
            wanted = int(SECONDS_BETWEEN_CHECKS * count / max(seconds, 1e-9))
            self._steps_unchecked = min(max(1, wanted), MOST_STEPS_UNCHECKED)
            self._save_if_due()
            interrupts.deliver()
        return {"steps": done}

    def _set_step(self, dt: float) -> None:
        self._clock = self._clock.with_step(dt)
        if dt != self._step_set:
            for block in self._blocks:
                block.set_step(dt, [self._stable_dt[m] for m in block.members])
            self._step_set = dt

    def _above_stable_dt(self) -> list[int]:
        """Members whose energies are watched: those to which nothing but the step can give any."""
        above = [
            member for member, scene in enumerate(self._scenes)
            if not self._frozen[member] and not scene.spheres
            and self._clock.dt > self._stable_dt[member]
        ]  # fmt: skip
        for member in above:
            if member not in self._watches:
                self._watches[member] = EnergyWatch(self._scenes[member])
        return above

    def _runaway(self) -> dict[str, Any] | None:
        """The first watched member whose energy has run away, in the form of `Block.told`."""
        values = self._values(self._downloaded())
        for member in self._watched:
            shape = (*self._scenes[member].cloth.shape, 3)
            x, v = values[member].reshape(2, 3, -1).transpose(0, 2, 1).reshape(2, *shape)
            point = self._watches[member].runaway_point(x, v)
            if point is not None:
                return {"member": member, "point": point, "shut_in": False}
        return None

    def _count_contacts(self) -> None:
        for block in self._blocks:
            for member, count in zip(block.members, block.contacts, strict=True):
                self._contacts[member] += int(count)

    def _advance(self, steps: int) -> dict[str, Any] | None:
        """`steps` steps after a checkpoint; the first member in trouble, its point and which."""
        handle = self.device.handle
        times = [self._clock.at(k) for k in range(steps + 1)]
        for block in self._blocks:
            block.begin(times)
        encoder = handle.create_command_encoder()
        for block in self._blocks:
            block.save(encoder)
        for first in range(0, steps, STEPS_PER_SUBMISSION):
            count = min(STEPS_PER_SUBMISSION, steps - first)
            work = encoder.begin_compute_pass()
            for block in self._blocks:
                block.dispatch(work, count)
                if first + count == steps:
                    block.check(work)
            work.end()
            if first + count < steps:
                handle.queue.submit([encoder.finish()])
                encoder = handle.create_command_encoder()
        for block in self._blocks:
            block.copy_results(encoder)
        handle.queue.submit([encoder.finish()])
        told = [block.told() for block in self._blocks]
        pinned = [point for _, point in told if point]
        self._pinned_inside = self._pinned_inside or min(pinned, default=None)
        bad = [one for one, _ in told if one]
        if self._watched and (runaway := self._runaway()):
            bad.append(runaway)
        return min(bad, key=lambda one: one["member"], default=None)

    def _restore_checkpoint(self) -> None:
        encoder = self.device.handle.create_command_encoder()
        for block in self._blocks:
            block.restore(encoder)
        self.device.handle.queue.submit([encoder.finish()])

    def _rewind_to_last_good(self, steps: int) -> dict[str, Any]:
        """Find the step that goes wrong and stand before it: the same steps give the same bits."""
        self._restore_checkpoint()
        for k in range(1, steps + 1):
            bad = self._advance(1)
            if bad:
                self._restore_checkpoint()
                return {**bad, "step": k, "time": self._clock.at(1)}
            self._count_contacts()
            self._clock = self._clock.after(1)
        raise RuntimeError(
            f"the graphics adapter {self.adapter.name} gave another result for the same steps"
        )

    def _save_if_due(self) -> None:
        least = max(SECONDS_BETWEEN_COPIES, self._saving_took / PART_OF_TIME_FOR_COPIES)
        if time.monotonic() - self._saved_at > least:
            self._save()

    # Faults ---------------------------------------------------------------------------------------

    @contextmanager
    def _used(self) -> Any:
        """One caller at a time; a lost adapter is told in our words, the last safe state kept."""
        self.device.check_process()
        if not self._busy.acquire(blocking=False):
            raise RuntimeError(
                "this state is being advanced by another thread; give each thread a Stepper of "
                "its own"
            )
        try:
            with translated(self.adapter):
                yield
        except AdapterLostError as error:
            if not self._lost:
                self._lost = True
                devices.forget(self.device)
            raise AdapterLostError(f"{error}; {self._what_is_safe()}", self.time) from error
        finally:
            self._busy.release()

    def _need_adapter(self) -> None:
        if self._lost:
            raise AdapterLostError(f"the graphics adapter {self.adapter.name} was lost")

    def _what_is_safe(self) -> str:
        if not hasattr(self, "_saved"):
            return "no state had been copied to it"
        return (
            f"the state at t = {self.time:g} s is safe: positions and velocities give it, and "
            "Stepper.restore(stepper.snapshot()) goes on from it"
        )
