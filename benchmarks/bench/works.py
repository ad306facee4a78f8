"""Scenes and states for timing, and works that time the core and the reference."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.scenes import PAPER_DT
from timing import Work

from . import machine_facts
from .settings import BATCH, CONTACT_TIME, STATE_DT, STATE_TIME

_HORIZON = 0.02  # s that a figure's cloth may move on before it is put back


@dataclass(frozen=True)
class Start:
    """A named scene (or batch of them) in a state."""

    name: str
    scene: cs.Scene | Sequence[cs.Scene]
    x: np.ndarray
    v: np.ndarray
    t: float = 0.0

    @property
    def one(self) -> cs.Scene:
        return self.scene if isinstance(self.scene, cs.Scene) else self.scene[0]

    @property
    def members(self) -> int:
        return 1 if isinstance(self.scene, cs.Scene) else len(self.scene)


def _after(scene: cs.Scene, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    return cs.step(scene, scene.initial_position, scene.initial_velocity, STATE_DT, round(seconds / STATE_DT))


@lru_cache
def falling(bend: bool) -> tuple[np.ndarray, np.ndarray]:
    """The paper's cloth after `STATE_TIME`."""
    return _after(cs.scenes.paper_swing(bend=bend), STATE_TIME)


def paper(bend: bool, sphere: bool) -> Start:
    """The paper's cloth in free fall. With `sphere`, the sphere of the paper's section 6 is present, but out of
    reach.
    """
    scene = cs.scenes.paper_static(bend=bend) if sphere else cs.scenes.paper_swing(bend=bend)
    name = ("static" if sphere else "swing") + ("+bend" if bend else "")
    return Start(name, scene, *falling(bend), STATE_TIME)


def contact(bend: bool) -> Start:
    """The paper's cloth in contact with its sphere."""
    scene = cs.scenes.paper_static(bend=bend)
    name = "contact" + ("+bend" if bend else "")
    return Start(name, scene, *_after(scene, CONTACT_TIME), CONTACT_TIME)


def batch(members: int = BATCH) -> Start:
    """Cloths that differ in stiffness, in free fall."""
    scene = cs.scenes.paper_swing(bend=True)
    scenes = [scene.replace(cloth=scene.cloth.replace(stiffness=float(k))) for k in np.linspace(30_000, 35_000, members)]
    x, v = falling(True)
    name = "batch" if members == BATCH else f"batch of {members}"
    return Start(name, scenes, np.stack([x] * members), np.stack([v] * members), STATE_TIME)


def grid(rows: int) -> Start:
    """A square grid of the paper's mass points and cells, all springs, in waves."""
    side = (rows - 1) / 31
    cloth = cs.Cloth((rows, rows), (side, side), mass=0.5 * rows * rows)
    x = cloth.rest_positions.copy()
    x[..., 1] = 2e-3 * np.sin(9 * x[..., 0]) * np.cos(7 * x[..., 2])
    v = 0.5 * np.cos(8 * x + 1)
    v[cloth.pinned] = 0.0
    return Start(f"grid {rows}", cs.Scene(cloth), x, v)


class Core(Work):
    """A `Stepper` of one kernel, precision, thread count and instruction set."""

    def __init__(
        self, start: Start, *, by: str, precision: str, threads: int | None, instruction_set: str, strict: bool = False
    ) -> None:
        self.start = start
        self.instruction_set = instruction_set
        self.options: dict[str, Any] = {"kernel": by, "precision": precision, "threads": threads, "strict": strict}
        self.rewind()

    def rewind(self) -> None:
        start = self.start
        with machine_facts.instruction_set(self.instruction_set):
            self.stepper = cs.Stepper(start.scene, start.x, start.v, t=start.t, **self.options)

    def prepare(self) -> None:
        if self.time > self.start.t + _HORIZON:
            self.rewind()

    def run(self, steps: int) -> None:
        self.stepper.advance(steps, PAPER_DT)

    @property
    def time(self) -> float:
        return self.stepper.time

    @property
    def positions(self) -> np.ndarray:
        return self.stepper.positions

    @property
    def flops(self) -> int:
        with machine_facts.instruction_set(self.instruction_set):
            return int(self.start.one.explain(**self.options)["flops_per_step"])


class Frames(Core):
    """The core as in a drawing loop: one step per call, then a copy of the positions."""

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.stepper.advance(1, PAPER_DT)
            self.stepper.positions  # noqa: B018


class Paused(Core):
    """The first steps after a pause, in which threads and processors have gone to sleep.

    Each window is a call of `cold_steps` steps.
    """

    PAUSE = 0.05  # s
    BEFORE = 100  # steps, so that the pause comes after a run, also of a stepper that is new

    def __init__(self, start: Start, cold_steps: int, **options: Any) -> None:
        super().__init__(start, **options)
        self.cold_steps = cold_steps

    def prepare(self) -> None:
        super().prepare()
        self.run(self.BEFORE)
        time.sleep(self.PAUSE)


class Calls(Core):
    """One step a call."""

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self.stepper.advance(1, PAPER_DT)


class StepCalls(Core):
    """One step a call of `clothsim.step`, which copies the state in and out."""

    def rewind(self) -> None:
        self.x, self.v, self.t = self.start.x, self.start.v, self.start.t

    def run(self, steps: int) -> None:
        scene = self.start.scene
        with machine_facts.instruction_set(self.instruction_set):
            for _ in range(steps):
                self.x, self.v = cs.step(scene, self.x, self.v, PAPER_DT, t=self.t, **self.options)
                self.t += PAPER_DT

    @property
    def time(self) -> float:
        return self.t

    @property
    def positions(self) -> np.ndarray:
        return self.x


class Reference(Work):
    """The scalar oracle; each run starts from the same state."""

    def __init__(self, start: Start) -> None:
        self.start = start
        self.positions, self.velocities = start.x, start.v

    def run(self, steps: int) -> None:
        start = self.start
        self.positions, self.velocities = cs.reference_step(start.one, start.x, start.v, PAPER_DT, steps, start.t)
