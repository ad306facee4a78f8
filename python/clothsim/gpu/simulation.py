"""A simulation on the graphics adapter, with the interface of the core's (`_core.Simulation`)."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.interrupts import Interrupts
from ..model.scene import Scene
from . import device as devices
from .block import MOST_STEPS_UNCHECKED, Block
from .device import Device, translated
from .planes import arrays_of, far_origins, joined, planes_of, split, stop_pinned_points, vectors_of
from .shader import check_scenes

# The state is inspected after as many steps as this takes [s], or fewer.
SECONDS_BETWEEN_CHECKS = 0.02

_NOT_WATCHED = "the graphics adapter does not watch the states between frames"


@dataclass(frozen=True)
class Clock:
    """Times in s, with the core's bits: that of step k is counted from an origin, so that rounding does not add up."""

    origin: float
    steps: int = 0
    dt: float = 0.0

    def at(self, further: int) -> float:
        return self.origin + float(self.steps + further) * self.dt

    def now(self) -> float:
        return self.at(0)

    def after(self, steps: int) -> Clock:
        return replace(self, steps=self.steps + steps)


class Simulation:
    """One cloth, or a batch of cloths of one shape, advanced together on `device`, or on the chosen adapter.

    Errors: a ValueError if the adapter has no float64 for "double", or a limit of it is exceeded; a MemoryError if its
    memory does not suffice; a RuntimeError if there is no adapter; an ImportError if wgpu is missing.
    """

    def __init__(self, scenes: Sequence[Scene], time: float, precision: str, device: Device | None = None) -> None:
        self.device = device or devices.opened()
        self.adapter = self.device.adapter
        if precision == "double" and not self.device.float64:
            raise ValueError(
                f"precision must be 'single' on the graphics adapter {self.adapter.name}, "
                "whose shaders have no float64, got 'double'"
            )
        check_scenes(scenes)
        self._scenes = list(scenes)
        self._precision = precision
        self._single = precision == "single"
        self._members = len(self._scenes)
        self._clock = Clock(time)
        self._stable_dt = [math.inf] * self._members
        self._frozen = [False] * self._members
        self._contacts = [0] * self._members
        self._origins = np.zeros((self._members, 3))
        self._make_block()
        self._busy = threading.Lock()
        self._steps_unchecked = 1
        self._parts: list[np.ndarray] = []  # the state in host memory, as `split` gives it; up to date for frozen members

    def _make_block(self) -> None:
        self._block: Block | None = None  # frees the memory of the one that there is
        self._block = self._new_block(self._scenes)
        self._step_set = 0.0

    def _new_block(self, scenes: Sequence[Scene]) -> Block | None:
        """The members that are not frozen; None: all are."""
        members = [member for member, frozen in enumerate(self._frozen) if not frozen]
        chosen = [scenes[member] for member in members]
        if not members:
            return None
        return Block(self.device, members, chosen, self._origins[members], self._precision)

    # State in and out -----------------------------------------------------------------------------

    def load(self, x: np.ndarray | None, v: np.ndarray | None, time: float | None = None) -> None:
        """Set positions and velocities, shape ([B,] rows, columns, 3), and the time; None leaves a value as it is.
        Pinned points get the velocity 0.
        """
        with self._used():
            if x is None or v is None:
                shape = (self._members, *self._scenes[0].cloth.shape, 3)
                own = arrays_of(joined(self._state(), self._origins), shape)
                x, v = (one if given is None else given for one, given in zip(own, (x, v), strict=True))
            planes = planes_of(x, v, self._scenes)
            if time is not None:
                self._clock = Clock(time)
            if self._single:
                origins = far_origins(planes[:, :3])
                if (origins != self._origins).any():
                    self._origins = origins
                    self._make_block()
                planes[:, :3] -= self._origins[:, :, None]
            self._take(split(planes, self._single))

    def step(self, time: float, x: Any, v: Any, steps: int, dt: float, threads: int, x_out: Any, v_out: Any) -> Any:
        """A whole call: a state in, steps, and the state out if no event has to be reported."""
        self.load(x, v, time)
        return self.advance(steps, dt, threads)  # an outcome, after which the caller stores the state

    def set_scene(self, scenes: Sequence[Scene], stable_dt: Sequence[float]) -> None:
        """Replace the scenes and the guaranteed time steps [s]; the state stays, and pinned points stop."""
        with self._used():
            check_scenes(scenes)
            parts = [np.array(part) for part in self._state()]
            block = self._new_block(scenes)
            for part in parts:
                stop_pinned_points(part, scenes)
            self._scenes, self._block = list(scenes), block
            self._contacts = [0] * self._members
            self.set_stable_dt(stable_dt)
            self._take(parts)

    def _take(self, parts: Sequence[np.ndarray]) -> None:
        self._parts = [np.array(part) for part in parts]
        if self._block:
            self._block.upload(parts)

    def _state(self) -> list[np.ndarray]:
        if self._block:
            self._parts = self._block.download(self._parts)
        return self._parts

    def store(self, x: np.ndarray | None, v: np.ndarray | None) -> None:
        """Write positions and velocities into arrays of the shape that `load` takes, or None."""
        with self._used():
            planes = joined(self._state(), self._origins)
            for first, array in ((0, x), (3, v)):
                if array is not None:
                    array[...] = vectors_of(planes, first, array.shape)

    def snapshot(self) -> dict[str, Any]:
        """The clock and the whole state, with the fields of the core's; there are no impulses."""
        with self._used():
            parts, clock = self._state(), self._clock
            shape = (self._members, *self._scenes[0].cloth.shape, 3)
            fields: dict[str, Any] = {}
            for name, part in zip(("", "_low"), parts):
                arrays = arrays_of(part.astype(np.float64), shape)
                fields["positions" + name], fields["velocities" + name] = arrays
            return {
                **fields,
                "origins": self._origins.copy(),
                "frozen": np.array(self._frozen),
                "time": clock.now(),
                "clock_origin": clock.origin,
                "clock_steps": clock.steps,
                "clock_step": clock.dt,
            }

    def restore(self, fields: dict[str, Any]) -> None:
        """Return to the state of `snapshot`."""
        with self._used():
            names = ("", "_low") if self._single else ("",)
            parts = [planes_of(fields["positions" + n], fields["velocities" + n], self._scenes) for n in names]
            self._frozen, self._origins = [bool(one) for one in fields["frozen"]], np.array(fields["origins"])
            self._make_block()
            self._clock = Clock(float(fields["clock_origin"]), int(fields["clock_steps"]), float(fields["clock_step"]))
            self._take([part.astype(self._parts[0].dtype) for part in parts])

    @property
    def time(self) -> float:
        return self._clock.now()

    @time.setter
    def time(self, time: float) -> None:
        with self._used():
            parts = self._state()
            self._clock = Clock(time)
            self._take(parts)

    # The rest of the core's interface -------------------------------------------------------------

    def set_sphere(self, sphere: int, centers: Any, motions: Any) -> None:
        raise ValueError("centers must be None with backend 'gpu'; backend='cpu' moves spheres by hand")

    def set_force(self, force: np.ndarray) -> None:
        raise ValueError("set_force needs backend 'cpu': the compute shader has no force on points")

    def set_stable_dt(self, stable_dt: Sequence[float]) -> None:
        """Set the guaranteed time step of each member [s]. The core checks speeds only above this step."""
        self._stable_dt, self._step_set = list(stable_dt), 0.0

    def set_frozen(self, member: int, frozen: bool) -> None:
        """Exclude a member from further steps, or include it again."""
        with self._used():
            parts = self._state()
            self._frozen[member] = frozen
            self._make_block()
            self._take(parts)

    @property
    def frozen(self) -> list[bool]:
        return list(self._frozen)

    @property
    def evaluations(self) -> list[int]:
        """Not counted: a step of rk4 takes four."""
        return [0] * len(self._contacts)

    @property
    def contacts(self) -> list[int]:
        """Number of responses to mass points so far."""
        return list(self._contacts)

    def set_watch(self, every: int, interval: float) -> None:
        """Do nothing: the adapter watches no state between calls, and `watched` says so."""

    def sample(self) -> None:
        """Do nothing; see `set_watch`."""

    @property
    def watched(self) -> list[dict[str, Any]]:
        """Extremes per member, with the keys of the core. Each is NaN with a "reason", because the adapter does not
        watch them.
        """
        names = ("first_contact", "point_depth", "triangle_depth", "stretch", "energy_gained")
        missing = {**dict.fromkeys(names, math.nan), "reason": _NOT_WATCHED}
        none_inside = {"point_depth": 0.0, "triangle_depth": 0.0}
        return [
            {
                **missing,
                **(none_inside if not scene.spheres else {}),
                "in_contact": count > 0 or any(sphere.response == "continuous" for sphere in scene.spheres),
                "impulse": [[math.nan] * 3 for _ in scene.spheres],
            }
            for scene, count in zip(self._scenes, self._contacts, strict=True)
        ]

    # Stepping -------------------------------------------------------------------------------------

    def advance(self, steps: int, dt: float, threads: int) -> dict[str, Any]:
        """Take steps and return the outcome in the core's form: steps done, and the bad point if there is one."""
        with self._used(), Interrupts() as interrupts, self._all_or_nothing():
            self._set_step(dt)
            self._found: dict[str, Any] = {}
            return {**self._advance(steps, interrupts), **self._found}

    def _advance(self, steps: int, interrupts: Interrupts) -> dict[str, Any]:
        done = 0
        while done < steps:
            count = min(self._steps_unchecked, steps - done)
            start = time.monotonic()
            if self._try(count):
                found = self._rewind_to_last_good(count)
                return {**found, "step": done + found["step"], "steps": done + found["step"] - 1}
            self._accept(count)
            done += count
            seconds = time.monotonic() - start
            wanted = int(SECONDS_BETWEEN_CHECKS * count / max(seconds, 1e-9))
            self._steps_unchecked = min(max(1, wanted), MOST_STEPS_UNCHECKED)
            interrupts.deliver()
        return {"steps": done}

    def _set_step(self, dt: float) -> None:
        if dt != self._clock.dt:
            self._clock = Clock(self._clock.now(), 0, dt)
        if dt != self._step_set:
            if self._block:
                self._block.set_step(dt, self._stable_dt)
            self._step_set = dt

    def _try(self, steps: int) -> tuple[int, int] | None:
        """Take `steps` steps that can be undone; return the first member with a bad point, and the point."""
        return self._block.run([self._clock.at(k) for k in range(steps + 1)]) if self._block else None

    def _accept(self, steps: int) -> None:
        if self._block:
            self._block.accept(self._contacts)
            self._found = {**self._block.found, **self._found}
        self._clock = self._clock.after(steps)

    def _take_back(self) -> None:
        if self._block:
            self._block.take_back()

    def _rewind_to_last_good(self, steps: int) -> dict[str, Any]:
        """Find the failing step and stop before it. Repeated steps give the same bits, so the search is exact."""
        self._take_back()
        for k in range(1, steps + 1):
            bad = self._try(1)
            if bad:
                self._take_back()
                return {"member": bad[0], "point": bad[1], "trapped": False, "step": k, "time": self._clock.at(1)}
            self._accept(1)
        raise RuntimeError(f"the graphics adapter {self.adapter.name} gave another result for the same steps")

    @contextmanager
    def _used(self) -> Any:
        """Admit one caller at a time, and translate errors of wgpu."""
        self.device.check_process()
        if not self._busy.acquire(blocking=False):
            raise RuntimeError("this state is being advanced by another thread; give each thread a Stepper of its own")
        try:
            with translated(self.adapter):
                yield
        finally:
            self._busy.release()

    @contextmanager
    def _all_or_nothing(self) -> Any:
        """Undo steps that were not accepted if an error occurs."""
        try:
            yield
        except Exception:
            self._take_back()
            raise
