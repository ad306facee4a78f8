"""Time per step of the kernels and of other programs, with the error beside it; docs/benchmarks.md
explains the figures.

python benchmarks/bench.py                       # all sections, a few minutes; prints a table
python benchmarks/bench.py --quick steps calls   # some sections, coarse figures
python benchmarks/bench.py --csv figures.csv     # also writes a CSV file
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, get_args

import clothsim as cs
import numpy as np
from clothsim.scenes import PAPER_DT
from clothsim.typing import Response
from common import aligned, conditions
from peers.numba_peer import NumbaPeer
from peers.numpy_peer import NumpyPeer
from timing import Work, measure

DTYPES = {"double": np.float64, "single": np.float32}
KERNELS = ("edge", "gather")
STATE_DT = 1e-4  # s, of the steps that lead to the timed state
HORIZON = 0.02  # s that a timed cloth may move on before it is put back
ERROR_STEPS = 1000
FRAMES = 5  # at which the error is taken
LARGEST_WITH_ERROR = 65_536  # points, which the scalar reference steps too


@dataclass(frozen=True)
class Start:
    """A scene, or a batch of them, in a state; `exact`: the error beside a time is taken against
    the reference.
    """

    name: str
    scene: Any
    x: np.ndarray
    v: np.ndarray
    t: float = 0.0
    exact: bool = False

    @property
    def first_scene(self) -> cs.Scene:
        return self.scene if isinstance(self.scene, cs.Scene) else self.scene[0]


@lru_cache
def after(scene: cs.Scene, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    return cs.step(
        scene,
        scene.initial_position,
        scene.initial_velocity,
        STATE_DT,
        round(seconds / STATE_DT),
        t=0.0,
    )


def swing(bend: bool = True) -> Start:
    """Return the paper's cloth after 0.25 s of fall."""
    scene = cs.scenes.paper_swing(bend=bend)
    return Start("swing, all springs" if bend else "swing", scene, *after(scene, 0.25), 0.25, True)


def contact(response: Response = "ray") -> Start:
    """Return the paper's cloth where it lies on its sphere."""
    scene = cs.scenes.paper_static(response, bend=True, offset="cell")
    return Start(f"on a sphere, {response}", scene, *after(scene, 0.6), 0.6)


def batch(members: int) -> Start:
    """Cloths that differ in stiffness, in free fall."""
    start = swing()
    cloth = start.scene.cloth
    scenes = [
        start.scene.replace(cloth=cloth.replace(stiffness=float(k)))
        for k in np.linspace(3e4, 3.5e4, members)
    ]
    return Start(
        f"batch of {members}",
        scenes,
        np.stack([start.x] * members),
        np.stack([start.v] * members),
        start.t,
    )


def grid(rows: int) -> Start:
    """Return a square grid of the paper's mass points and cells, all springs, in waves."""
    side = (rows - 1) / 31
    cloth = cs.Cloth((rows, rows), (side, side), mass=0.5 * rows * rows)
    x = cloth.rest_positions.copy()
    x[..., 1] = 2e-3 * np.sin(9 * x[..., 0]) * np.cos(7 * x[..., 2])
    v = 0.5 * np.cos(8 * x + 1)
    v[cloth.pinned] = 0.0
    return Start(f"{rows} x {rows}", cs.Scene(cloth), x, v, exact=rows * rows <= LARGEST_WITH_ERROR)


class Core(Work):
    """A `Stepper`; `call` is "advance" (a call of many steps), "advance(1)", "step"
    (`clothsim.step` of one step) or "simulate" (a run of one step, from the scene's own state).
    """

    def __init__(
        self,
        start: Start,
        call: str = "advance",
        instruction_set: str | None = None,
        **options: Any,
    ) -> None:
        self.start = start
        self.call = call
        self.set = instruction_set
        self.options = options
        self._rewind()

    def _rewind(self) -> None:
        start = self.start
        if self.set:
            os.environ["CLOTHSIM_ISA"] = self.set
        self.stepper = cs.Stepper(start.scene, start.x, start.v, t=start.t, **self.options)
        os.environ.pop("CLOTHSIM_ISA", None)
        self.out = np.empty_like(start.x), np.empty_like(start.v)

    def prepare(self) -> None:
        if self.stepper.time > self.start.t + HORIZON:
            self._rewind()

    def run(self, steps: int) -> None:
        start = self.start
        if self.call == "advance":
            self.stepper.advance(steps, PAPER_DT)
        elif self.call == "advance(1)":
            for _ in range(steps):
                self.stepper.advance(1, PAPER_DT)
        elif self.call == "simulate":
            for _ in range(steps):
                cs.simulate(start.scene, PAPER_DT, PAPER_DT, t=start.t, **self.options)
        else:
            for _ in range(steps):
                cs.step(
                    start.scene, start.x, start.v, PAPER_DT, t=start.t, out=self.out, **self.options
                )

    @property
    def positions(self) -> np.ndarray:
        return self.stepper.positions


class Reference(Work):
    """The scalar reference, spring by spring; each run starts from the same state."""

    def __init__(self, start: Start) -> None:
        self.start = start

    def run(self, steps: int) -> None:
        start = self.start
        self.positions, _ = cs.reference_step(
            start.first_scene, start.x, start.v, PAPER_DT, steps, start.t
        )


Candidate = tuple[
    Start, dict[str, Any], Callable[[], Any]
]  # labels of a row, and how its work is made


def core(start: Start, call: str = "advance", **options: Any) -> Candidate:
    labels = {"by": options["kernel"], **options, "call": call}
    return start, labels, partial(Core, start, call, **options)


def cores(
    start: Start, threads: tuple[int, ...] = (1,), kernels: tuple[str, ...] = KERNELS
) -> Iterator[Candidate]:
    for kernel in kernels:
        for precision in DTYPES:
            for count in threads:
                yield core(start, kernel=kernel, precision=precision, threads=count)


def numba(start: Start, threads: tuple[int, ...]) -> Iterator[Candidate]:
    for precision, dtype in DTYPES.items():
        for count in threads:
            make = partial(NumbaPeer, start.scene, start.x, start.v, PAPER_DT, dtype, count)
            yield start, {"by": "numba", "precision": precision, "threads": count}, make


def steps(threads: tuple[int, ...], quick: bool) -> Iterator[list[Candidate]]:
    """Yield the paper's cloth by kernel, precision, threads, instruction set and peer; contact."""
    for start in (swing(bend=False), swing()):
        group = [*cores(start, threads)]
        for name in cs.build_config()["instruction_sets_supported"][1:]:
            group += [
                core(start, kernel=k, precision=p, threads=1, instruction_set=name)
                for k in KERNELS
                for p in DTYPES
            ]
        group.append(
            (
                start,
                {"by": "reference", "precision": "double", "threads": 1},
                partial(Reference, start),
            )
        )
        for precision, dtype in DTYPES.items():
            make = partial(NumpyPeer, start.first_scene, start.x, start.v, PAPER_DT, dtype)
            group.append((start, {"by": "numpy", "precision": precision, "threads": 1}, make))
        yield group + [*([] if quick else numba(start, threads))]
    yield [candidate for response in get_args(Response) for candidate in cores(contact(response))]


def features(threads: tuple[int, ...], quick: bool) -> Iterator[list[Candidate]]:
    """Yield what each part of a scene adds to a step, on one thread."""
    base = swing()
    cloth = base.first_scene.cloth
    far = cs.Sphere((0.5, -9.0, 0.5))
    changes: dict[str, dict[str, Any]] = {
        "all springs, damped": {},
        **{
            f"no {f}": {"cloth": cloth.replace(springs=[g for g in cloth.springs if g != f])}
            for f in cloth.springs
        },
        "no damping": {"cloth": cloth.replace(damping=0.0)},
        "drag in place of damping": {"cloth": cloth.replace(damping=0.0, drag=0.5)},
        "mass per point": {
            "cloth": cloth.replace(mass=np.random.default_rng(0).uniform(0.4, 0.6, cloth.shape))
        },
        "1 sphere, far": {"spheres": (far,)},
        "4 spheres, far": {
            "spheres": tuple(far.replace(center=(0.5, -9.0 - k, 0.5)) for k in range(4))
        },
        "1 printed method 2, far": {"spheres": (far.replace(response="ray", as_printed=True),)},
    }
    starts = [
        Start(name, base.first_scene.replace(**change), base.x, base.v, base.t)
        for name, change in changes.items()
    ]
    yield [candidate for start in starts for candidate in cores(start)]


def batches(threads: tuple[int, ...], quick: bool) -> Iterator[list[Candidate]]:
    """Yield many cloths in one call; times are for one cloth."""
    for members in (64,) if quick else (64, 500):
        start = batch(members)
        yield [*cores(start, threads), *([] if quick else numba(start, threads))]


def grids(threads: tuple[int, ...], quick: bool) -> Iterator[list[Candidate]]:
    """Yield square cloths of growing size."""
    for rows in (8, 64, 256, 1024) if quick else (8, 16, 64, 128, 256, 512, 1024, 2048):
        start = grid(rows)
        yield [*cores(start, threads, KERNELS if rows <= 256 else ("edge",))]


def calls(threads: tuple[int, ...], quick: bool) -> Iterator[list[Candidate]]:
    """Yield a step of many in a call, a step a call, `clothsim.step`, and a run of one step."""
    for start in (swing(), contact("penalty")):
        options = [{"kernel": "edge", "precision": p, "threads": 1} for p in DTYPES]
        yield [
            core(start, call, **labels)
            for labels in options
            for call in ("advance", "advance(1)", "step", "simulate")
        ]


SECTIONS = {
    first_scene.__name__: first_scene for first_scene in (steps, features, batches, grids, calls)
}


def time_group(
    group: list[Candidate], windows: int, seconds: float, error_steps: int
) -> list[dict[str, Any]]:
    """Return a row for each candidate; say which programs cannot run here and are left out."""
    present, works = [], []
    for candidate in group:
        try:
            work = candidate[2]()
            work.run(1)  # compiles numba's kernels
        except ImportError as error:
            print(f"left out: {candidate[1]['by']}: {error}")
            continue
        present.append(candidate)
        works.append(work)
    rows = []
    expected: dict[str, list[np.ndarray]] = {}
    for (start, labels, make), timing in zip(
        present, measure(works, windows, seconds), strict=True
    ):
        cloth = start.first_scene.cloth
        members = start.x[..., 0, 0, 0].size
        errors = []
        if (
            start.exact
            and labels.get("call", "advance") == "advance"
            and labels["by"] != "reference"
        ):
            if start.name not in expected:
                expected[start.name] = _frames(start, error_steps)
            work = make()
            work.prepare()
            for exact in expected[start.name]:
                work.run(error_steps // FRAMES)
                errors.append(float(np.linalg.norm(work.positions - exact, axis=-1).max()))
        rows.append(
            {
                "work": start.name,
                **{key: labels.get(key) for key in LABELS},
                "points": cloth.rows * cloth.columns,
            }
            | {"springs": cloth.spring_count(), "least_us": 1e6 * timing.minimum / members}
            | {"median_us": 1e6 * timing.median / members, "spread_%": 100 * timing.spread}
            | ({"error_m": errors[-1], "frames_error_m": max(errors)} if errors else {})
        )
    single_calls = {r["precision"]: r["least_us"] for r in rows if r["call"] == "advance(1)"}
    for row in rows:
        if single_calls:
            row["over_advance(1)"] = row["least_us"] / single_calls[row["precision"]]
    return rows


def _frames(start: Start, steps: int) -> list[np.ndarray]:
    """Positions by the scalar reference at every FRAMES-th part of the steps."""
    x = start.x
    v = start.v
    t = start.t
    frames = []
    for _ in range(FRAMES):
        x, v = cs.reference_step(start.first_scene, x, v, PAPER_DT, steps // FRAMES, t)
        t += steps // FRAMES * PAPER_DT
        frames.append(x)
    return frames


LABELS = ("by", "precision", "threads", "instruction_set", "call")
COLUMNS = (
    "work",
    *LABELS,
    "points",
    "springs",
    "least_us",
    "median_us",
    "spread_%",
    "over_advance(1)",
    "error_m",
    "frames_error_m",
)


def cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "sections", nargs="*", choices=[[], *SECTIONS], metavar="SECTION", help=", ".join(SECTIONS)
    )
    parser.add_argument("--quick", action="store_true", help="fewer and shorter windows")
    parser.add_argument(
        "--csv", type=Path, metavar="FILE", help="also write the figures to a CSV file"
    )
    args = parser.parse_args(argv)
    threads = tuple(sorted({1, min(2, os.cpu_count() or 1), os.cpu_count() or 1}))
    rows = []
    for name in args.sections or SECTIONS:
        for group in SECTIONS[name](threads, args.quick):
            timings = time_group(group, *(8, 2e-3, 100) if args.quick else (40, 4e-3, ERROR_STEPS))
            print(aligned(COLUMNS, ([cell(row.get(key)) for key in COLUMNS] for row in timings)))
            print(f"{conditions(('numba',))}\n", flush=True)
            rows += timings
    if args.csv:
        with args.csv.open("w", newline="") as file:
            file.write(f"# {conditions(('numba',))}\n")
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows({key: cell(row.get(key)) for key in COLUMNS} for row in rows)


if __name__ == "__main__":
    main()
