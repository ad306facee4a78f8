"""All members of a batch on the adapter, and steps of all of them in one go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..model.scene import Scene
from .block import Block
from .device import Device
from .shader import Features

# Steps after which the state is looked at, at most; the exact step of a failure is then found by
# going back.
MOST_STEPS_UNCHECKED = 96
# Steps a submission: the adapter works on one while the host records the next.
STEPS_PER_SUBMISSION = 32


@dataclass(frozen=True)
class Told:
    """Findings of the steps.

    Attributes
    ----------
    bad : dict or None
        "member", "point" and "trapped" of the first member in trouble.
    pinned_inside : (int, int) or None
        Member and pinned point that a sphere has run into.
    """

    bad: dict[str, Any] | None
    pinned_inside: tuple[int, int] | None


class Blocks:
    """Members grouped by the features of their scenes, each group a `Block`.

    Parameters
    ----------
    device : Device
    scenes : sequence of Scene
        The scene of each member; all have one shape.
    precision : {"single", "double"}
    strict : bool
    """

    def __init__(self, device: Device, scenes: Sequence[Scene], precision: str, strict: bool) -> None:
        self._device, self._scenes = device, scenes
        self._precision, self._strict = precision, strict
        self._blocks: list[Block] = []
        self._ahead = False

    def make(self, frozen: Sequence[bool], origins: np.ndarray) -> None:
        """Make the blocks anew, without frozen members; `origins` are the origins of positions."""
        alike: dict[Features, list[int]] = {}
        for member, scene in enumerate(self._scenes):
            if not frozen[member]:
                alike.setdefault(Features.of(scene), []).append(member)
        self._blocks = []  # frees the memory of those that there are
        self._ahead = False
        for members in alike.values():
            scenes = [self._scenes[m] for m in members]
            block = Block(
                self._device, members, scenes, origins[members], self._precision, self._strict, MOST_STEPS_UNCHECKED
            )
            self._blocks.append(block)

    def upload(self, parts: Sequence[np.ndarray]) -> None:
        """Upload the state of all members, in the form of `planes.split`."""
        for block in self._blocks:
            block.upload([part[block.members] for part in parts])

    def download(self, parts: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Download the state of all members; frozen members keep their values of `parts`."""
        parts = [part.copy() for part in parts]
        for block in self._blocks:
            for part, values in zip(parts, block.download(), strict=True):
                part[block.members] = values
        return parts

    def set_step(self, dt: float, stable_dt: Sequence[float]) -> None:
        """Set the time step `dt` [s]; `stable_dt` has the guaranteed step of each member."""
        for block in self._blocks:
            block.set_step(dt, [stable_dt[m] for m in block.members])

    def run(self, times: Sequence[float]) -> Told:
        """Save a checkpoint and take the steps between `times`. `accept` keeps them, and `take_back` undoes them."""
        handle, steps = self._device.handle, len(times) - 1
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
                self._ahead = True
                encoder = handle.create_command_encoder()
        for block in self._blocks:
            block.copy_results(encoder)
        handle.queue.submit([encoder.finish()])
        self._ahead = True
        told = [block.told() for block in self._blocks]
        bad = [one for one, _ in told if one]
        pinned = [point for _, point in told if point]
        first_bad = min(bad, key=lambda one: one["member"], default=None)
        return Told(first_bad, min(pinned, default=None))

    def take_back(self) -> None:
        """Return to the checkpoint of `run`, unless its steps were accepted."""
        if not self._ahead:
            return
        encoder = self._device.handle.create_command_encoder()
        for block in self._blocks:
            block.restore(encoder)
        self._device.handle.queue.submit([encoder.finish()])
        self._ahead = False

    def accept(self, contacts: list[int]) -> None:
        """Keep the steps of the last `run`, and add their contact responses to the count of each member."""
        self._ahead = False
        for block in self._blocks:
            for member, count in zip(block.members, block.contacts, strict=True):
                contacts[member] += int(count)
