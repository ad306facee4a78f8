"""The error of a run, as error control estimates it, and what it cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .fixed_steps import Solution
from .frames import Floats

CONTACT = "a sphere responded: nearby trajectories part, and only outcomes can be compared"
NOT_ASKED = "no estimate was asked for"


@dataclass
class Estimate:
    """An error of the last positions [m], over the mass points; NaN if it is unknown.

    `reason`: why it is unknown, or why it is larger than what was asked for.
    """

    max: float
    rms: float
    reason: str = ""

    @classmethod
    def of(cls, x: Floats, better: Floats, factor: float) -> Estimate:
        """`factor` times the distance of positions from better ones, and half a unit in the last place."""
        distances = factor * np.linalg.norm(x - better, axis=-1) + np.spacing(np.abs(x).max()) / 2
        return cls(float(distances.max()), float(np.sqrt((distances**2).mean())))

    @classmethod
    def unknown(cls, reason: str) -> Estimate:
        return cls(math.nan, math.nan, reason)

    def because(self, reason: str) -> Estimate:
        return Estimate(self.max, self.rms, reason)


@dataclass
class Controlled:
    """A solution, its error, and what everything else has cost."""

    solution: Solution
    error: Estimate
    better: Solution | None  # after a contact
    evaluations: int
    wall_time: float  # [s]
