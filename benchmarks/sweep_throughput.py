"""How fast a sweep is beside the bare batch: `python benchmarks/sweep_throughput.py`.

The batch is 64 cloths of 32 x 32 mass points that differ in stiffness, in one call. The sweep runs equal cloths for equal
steps from an equal state, with the default metrics and a store. Both take turns, and the fastest window of each counts.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import clothsim as cs
import numpy as np
from bench import batch
from clothsim.scenes import PAPER_DT
from clothsim.typing import Precision


class Pair:
    """The batch and the sweep of the same cloths."""

    def __init__(self, precision: Precision, threads: int | None, steps: int) -> None:
        self.start = batch(64)
        assert not isinstance(self.start.scene, cs.Scene)
        self.scenes = self.start.scene
        self.precision, self.threads, self.steps = precision, threads, steps
        first = self.start.one
        self.scene = first.replace(position=self.start.x[0], velocity=_free(first, self.start.v[0]))
        self.stiffness = [scene.cloth.stiffness for scene in self.scenes]

    @property
    def member_steps(self) -> int:
        return self.steps * len(self.stiffness)

    def batch(self) -> np.ndarray:
        """Only the steps are timed by the caller; the state is made by `prepare`."""
        self.stepper.advance(self.steps, PAPER_DT)
        return self.stepper.positions

    def prepare(self) -> None:
        scenes = [self.scene.replace(cloth=s.cloth) for s in self.scenes]
        options: dict[str, Any] = {"precision": self.precision, "threads": self.threads}
        self.stepper = cs.Stepper(scenes, **options)
        self.stepper.advance(20, PAPER_DT)  # wakes threads and fills caches
        self.stepper = cs.Stepper(scenes, **options)

    def sweep(self, **options: Any) -> Any:
        return cs.sweep(
            self.scene,
            {"stiffness": self.stiffness},
            dt=PAPER_DT,
            duration=self.steps * PAPER_DT,
            precision=self.precision,
            threads=self.threads,
            progress=False,
            **options,
        )

    def errors(self) -> dict[str, float]:
        """Largest distance [m] of the ends from those of RK4 in double with half the step."""
        self.prepare()
        ends = {"batch": self.batch(), "sweep": self.sweep(frames=True).position.values[:, -1]}
        scenes = [self.scene.replace(cloth=s.cloth) for s in self.scenes]
        x = np.stack([self.scene.initial_position] * len(scenes))
        v = np.stack([self.scene.initial_velocity] * len(scenes))
        exact, _ = cs.step(scenes, x, v, PAPER_DT / 2, 2 * self.steps)
        return {n: float(np.linalg.norm(e - exact, axis=-1).max()) for n, e in ends.items()}


def measure(precision: Precision, threads: int | None, steps: int, windows: int) -> dict[str, Any]:
    """Member-steps per second of both by the clock and by processor time, and their errors [m]."""
    pair = Pair(precision, threads, steps)
    errors = pair.errors()  # also the imports and first calls, untimed
    seconds: dict[str, list[tuple[float, float]]] = {"batch": [], "sweep": []}
    with tempfile.TemporaryDirectory() as folder:
        for window in range(windows):
            pair.prepare()
            seconds["batch"].append(_seconds(lambda: pair.stepper.advance(steps, PAPER_DT)))
            store = Path(folder) / f"{window}.zarr"
            seconds["sweep"].append(_seconds(partial(pair.sweep, store=store)))
    rates = {n: pair.member_steps / min(wall for wall, _ in t) for n, t in seconds.items()}
    work = {n: min(processor for _, processor in t) for n, t in seconds.items()}
    return {
        "precision": precision,
        **rates,
        "ratio": rates["sweep"] / rates["batch"],
        "processor_ratio": work["batch"] / work["sweep"],
        "batch_error": errors["batch"],
        "sweep_error": errors["sweep"],
    }


def _seconds(function: Callable[[], Any]) -> tuple[float, float]:
    """Seconds on the clock, and of processors."""
    wall, processor = time.perf_counter(), time.process_time()
    function()
    return time.perf_counter() - wall, time.process_time() - processor


def _free(scene: Any, v: np.ndarray) -> np.ndarray:
    return np.where(scene.cloth.pinned[..., None], 0.0, v)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/sweep_throughput.py", description="A sweep's speed beside the batch's."
    )
    parser.add_argument("--windows", type=int, default=10, help="of each (default 10)")
    parser.add_argument("--steps", type=int, default=2000, help="of a member (default 2000)")
    parser.add_argument("--threads", type=int, help="default: all")
    args = parser.parse_args()
    print("64 cloths of 32 x 32 mass points, all springs; member-steps per second, fastest window")
    print("                                    sweep/batch  of processor")
    print("precision       batch       sweep      by clock          time  batch error [m]  sweep error [m]")
    for precision in ("double", "single"):
        row = measure(precision, args.threads, args.steps, args.windows)
        print(
            f"{precision:9} {row['batch']:11,.0f} {row['sweep']:11,.0f} {row['ratio']:13.3f} "
            f"{row['processor_ratio']:13.3f} {row['batch_error']:16.2e} {row['sweep_error']:16.2e}"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
