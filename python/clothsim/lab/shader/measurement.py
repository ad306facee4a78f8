"""One target's runs of experiment 4 with one scene."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from clothsim.gpu import Adapter
from clothsim.typing import Precision

SCALAR, SIMD, GPU = "scalar", "SIMD", "GPU"


@dataclass(frozen=True)
class Target:
    """Name of the target."""

    kind: str
    name: str
    threads: int = 1
    adapter: Adapter | None = None

    @property
    def software(self) -> bool:
        """Whether the target is a software adapter, which runs on the CPU."""
        return self.adapter is not None and self.adapter.software


@dataclass
class Measurement:
    """Result of one target with one scene."""

    target: Target
    method: int
    precision: Precision
    size: int
    members: int
    setup: list[float] = field(default_factory=list)  # s, per run
    first_frames: list[list[float]] = field(default_factory=list)  # s a step, per run and frame
    rates: list[float] = field(default_factory=list)  # steps/s, per run
    steps: list[int] = field(default_factory=list)  # in the window, per run
    frame_steps: int = 1
    asked: int = 0  # steps of a window that is not ended early
    limit: float = 0.0  # s after which one is

    @property
    def points(self) -> int:
        return self.size * self.size * self.members

    @property
    def rate(self) -> float:
        """Median steps/s of the runs."""
        return float(np.median(self.rates))

    @property
    def shortened(self) -> bool:
        """Whether windows were ended early."""
        return min(self.steps) < self.asked

    def quartiles(self) -> tuple[float, float]:
        low, high = np.quantile(self.rates, (0.25, 0.75))
        return float(low), float(high)
