"""Many cloths at once, by the bare batch and by a sweep: `python benchmarks/throughput.py`.

The cloths have 32 x 32 mass points and differ in stiffness. The batch is one call of a `Stepper`.
The sweep runs equal steps from an equal state, with the default metrics and a store. Both take
turns; the least time counts, with the interquartile range beside it. The error is the largest
distance of a mass point from dop853 in double at half the step, at the end.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from pathlib import Path
from typing import Any

import clothsim as cs
import numpy as np
from bench import batch
from clothsim.scenes import PAPER_DT
from common import Stopwatch, aligned, conditions
from timing import timing_of

HEAD = (
    "precision",
    "by",
    "members",
    "points",
    "dt s",
    "error m",
    "member-steps/s",
    "spread",
    "real-time factor",
    "of batch",
)


def measure(
    members: int, steps: int, dt: float, windows: int, options: dict[str, Any]
) -> list[tuple[str, ...]]:
    """Return a row for the batch and one for the sweep."""
    start = batch(members)
    x = start.x[0]
    v = np.where(start.first_scene.cloth.pinned[..., None], 0.0, start.v[0])
    scene = start.first_scene.replace(position=x, velocity=v)
    scenes = [scene.replace(cloth=member.cloth) for member in start.scene]
    over = {"stiffness": [member.cloth.stiffness for member in scenes]}
    ends: dict[str, np.ndarray] = {}
    seconds: dict[str, list[float]] = {"batch": [], "sweep": []}
    with tempfile.TemporaryDirectory() as folder:
        for window in range(windows + 1):  # the first, untimed, imports and keeps the ends
            stepper = cs.Stepper(scenes, **options)
            stepper.advance(1, dt)  # wakes threads
            stepper = cs.Stepper(scenes, **options)
            with Stopwatch() as watch:
                stepper.advance(steps, dt)
                ends["batch"] = stepper.positions
            seconds["batch"].append(watch.seconds)
            keep = (
                {"store": Path(folder) / f"{window}.zarr"}
                if window
                else {"metrics": {"last": lambda run: run.x[-1]}}
            )
            with Stopwatch() as watch:
                result = cs.sweep(
                    scene, over, dt=dt, duration=steps * dt, progress=False, **keep, **options
                )
            seconds["sweep"].append(watch.seconds)
            if not window:
                ends["sweep"] = result["last"].values
    exact, _ = cs.step(
        scenes,
        np.stack([x] * members),
        np.stack([v] * members),
        dt / 2,
        2 * steps,
        integrator="dop853",
    )
    rows = []
    least = min(seconds["batch"][1:])
    for name, durations in seconds.items():
        timing = timing_of(durations[1:])
        rate = members * steps / timing.minimum
        error = np.linalg.norm(ends[name] - exact, axis=-1).max()
        figures = (
            f"{members}",
            f"{x[..., 0].size}",
            f"{dt:g}",
            f"{error:.1e}",
            f"{rate:,.0f}",
            f"{timing.spread:.0%}",
        )
        rows.append(
            (
                options["precision"],
                name,
                *figures,
                f"{rate * dt:,.3g}",
                f"{least / timing.minimum:.2f}",
            )
        )
    return rows


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--members", type=int, default=64, help="default 64")
    parser.add_argument("--steps", type=int, default=2000, help="of a member (default 2000)")
    parser.add_argument(
        "--dt", type=float, default=PAPER_DT, help="time step [s] (default: the paper's)"
    )
    parser.add_argument("--windows", type=int, default=10, help="of each (default 10)")
    parser.add_argument("--threads", type=int, help="default: all")
    args = parser.parse_args(argv)
    warnings.simplefilter(
        "ignore", cs.StabilityWarning
    )  # the error tells whether the step was stable
    rows = []
    for precision in ("double", "single"):
        options = {"precision": precision, "threads": args.threads}
        rows += measure(args.members, args.steps, args.dt, args.windows, options)
    print(aligned(HEAD, rows, left=(0, 1)))
    print(conditions(("xarray", "zarr")))
    print("real-time factor: simulated seconds of all members per second")


if __name__ == "__main__":
    main()
