"""Acceptance targets of speed, judged on a saved run of the bench.

    python benchmarks/bench && python benchmarks/targets.py benchmarks/results/*.csv

Targets at errors are those of `ERRORS`; `python benchmarks/peers` measures them:

    python benchmarks/peers paper_swing --bend --threads 2 --fastest --errors 4e-7,2e-8,1e-12
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.figures import A_STEP_A_CALL, ALL_SPRINGS, CONTINUOUS, FEATURE, Measured, Missing, share_of_peak
from bench.saved import read
from common import aligned

LEFT_OUT = ("structural", "bend", "shear", "damping")


@dataclass(frozen=True)
class Target:
    """A bound on a value of the bench; `at_most` False: the value has to reach it."""

    name: str
    unit: str
    bound: float
    value: Callable[[Measured], float]
    at_most: bool = True
    prototype: str = ""

    def evaluate(self, measured: Measured) -> dict[str, Any]:
        """The target as a row: value and whether it is met, or why there is no value."""
        try:
            value = self.value(measured)
        except Missing as reason:
            return self.row(missing=str(reason))
        met = value <= self.bound if self.at_most else value >= self.bound
        return self.row(value=value, met=bool(met))

    def row(self, value: float | None = None, met: bool | None = None, missing: str | None = None) -> dict[str, Any]:
        return {
            "target": self.name,
            "unit": self.unit,
            "bound": self.bound,
            "at_most": self.at_most,
            "prototype": self.prototype,
            "value": value,
            "met": met,
            "missing": missing,
        }


def _microseconds(name: str, bound: float, prototype: str, work: str, by: str, precision: str, threads: int) -> Target:
    return Target(name, "us", bound, lambda m: 1e6 * m.seconds(work, by, precision, threads), prototype=prototype)


def _steps() -> Iterator[Target]:
    kinds = (
        ("static", "3,906 springs", "single", 2, 3.5, "3.35-3.5 *"),
        ("static", "3,906 springs", "single", 1, 6.5, "6.5 *"),
        ("static", "3,906 springs, stretch", "single", 1, 5.0, "6.5 *"),
        ("static+bend", "5,826 springs", "single", 1, 8.8, "9.3"),
        ("static+bend", "5,826 springs", "single", 2, 5.0, "5.2"),
        ("static+bend", "5,826 springs", "double", 1, 18.0, "20"),
        ("static+bend", "5,826 springs", "double", 2, 10.0, "11.1"),
    )
    for work, springs, precision, threads, bound, prototype in kinds:
        name = f"step, {springs}, {precision}, {threads} thread{'s' * (threads > 1)}"
        yield _microseconds(name, bound, prototype, work, "edge", precision, threads)
    for threads in (1, 2):
        yield _microseconds(
            f"step on the sphere, 3,906 springs, single, {threads} thread{'s' * (threads > 1)}",
            3.5 if threads == 2 else 6.5,
            "",
            "contact",
            "edge",
            "single",
            threads,
        )
    for precision, bound in (("single", 14.0), ("double", 33.0)):
        name = f"step, 5,826 springs, {precision}, 1 thread, gather"
        yield _microseconds(name, bound, "", "swing+bend", "gather", precision, 1)


def _against_numba(m: Measured, precision: str, threads: int) -> float:
    """numba's time on one thread over ours, or on its best thread count over ours on several."""
    ours = m.seconds("swing+bend", "edge", precision, threads)
    counts = (1,) if threads == 1 else m.threads
    return min(m.seconds("swing+bend", "numba strided", precision, n) for n in counts) / ours


def _peers() -> Iterator[Target]:
    for precision in ("single", "double"):
        yield Target(
            f"numba (strong, 1 thread) / ours on 1, {precision}",
            "x",
            2.9,
            lambda m, precision=precision: _against_numba(m, precision, 1),
            False,
            "2.7",
        )
        yield Target(
            f"numba (strong, its best thread count) / ours on 2, {precision}",
            "x",
            5.0,
            lambda m, precision=precision: _against_numba(m, precision, 2),
            False,
            "4.9-5.1",
        )
    yield Target(
        "scalar reference / ours on 1, double",
        "x",
        8.0,
        lambda m: m.seconds("swing", "reference", "double") / min(m.seconds("swing", k, "double") for k in m.kernels),
        False,
        "9.6",
    )
    yield Target(
        "scalar reference / ours on 1, double, AVX2",
        "x",
        4.0,
        lambda m: (
            m.seconds("swing", "reference", "double")
            / min(m.seconds("swing", k, "double", instruction_set="avx2") for k in m.kernels)
        ),
        False,
        "5.7",
    )


def _throughput() -> Iterator[Target]:
    for precision, bound, prototype in (("single", 4.6, "4.46"), ("double", 10.0, "10.3")):
        name = f"64 cloths, a cloth-step, {precision}, 2 threads"
        yield _microseconds(name, bound, prototype, "batch", "edge", precision, 2)
    for rows, bound, prototype in ((1024, 4.8, "6.0"), (4096, 5.5, "7.4")):
        yield Target(
            f"{rows} x {rows}, a point-step, single, 2 threads",
            "ns",
            bound,
            lambda m, rows=rows: 1e9 * _point_seconds(m, rows),
            prototype=prototype,
        )
    yield Target("slowest / fastest grid from 64 x 64 on, single, 2 threads", "x", 1.2, _flatness)
    yield Target(
        "800 x 800, single, 2 threads, a step a frame",
        "frames/s",
        300.0,
        lambda m: 1 / m.seconds(f"frame 800{A_STEP_A_CALL}", "edge", "single", 2),
        False,
        "260",
    )


def _point_seconds(m: Measured, rows: int) -> float:
    if rows not in m.sizes:
        raise Missing("measured by --full" if rows > 2048 else "not in this run")
    return m.seconds(f"grid {rows}", "edge", "single", 2) / rows**2


def _flatness(m: Measured) -> float:
    times = [_point_seconds(m, rows) for rows in m.sizes if rows >= 64]
    if len(times) < 2:
        raise Missing("not in this run")
    return max(times) / min(times)


def _machine() -> Iterator[Target]:
    for name, bound, prototype in (("avx2", 1.4, "1.4"), ("sse2", 3.6, "3.9")):
        yield Target(
            f"{name} / avx512, single, 1 thread",
            "x",
            bound,
            lambda m, name=name: (
                m.seconds("swing+bend", "edge", "single", instruction_set=name)
                / m.seconds("swing+bend", "edge", "single", instruction_set="avx512")
            ),
            prototype=prototype,
        )
    for precision in ("single", "double"):
        yield Target(
            f"share of the multiply-add peak, {precision}, 1 thread",
            "%",
            75.0,
            lambda m, precision=precision: 100 * share_of_peak(m, "edge", precision),
            False,
            "75" if precision == "single" else "",
        )


def _features() -> Iterator[Target]:
    for what in LEFT_OUT:
        yield Target(
            f"time saved without {what} / its share of the flops, single",
            "x",
            0.9,
            lambda m, what=what: _saving(m, what),
            False,
        )
    for name in ("1", *CONTINUOUS):
        yield Target(
            f"price of {'a' if name == '1' else f'a {name}'} sphere out of reach, single",
            "%",
            2.0,
            lambda m, name=name: (
                100
                * (
                    m.seconds(f"{FEATURE}{name} sphere, far", "edge", "single") / m.seconds(ALL_SPRINGS, "edge", "single")
                    - 1
                )
            ),
        )


def _saving(m: Measured, what: str) -> float:
    less = m.figure(f"{FEATURE}no {what}", "edge", "single")
    all_springs = m.figure(ALL_SPRINGS, "edge", "single")
    return (1 - less.minimum / all_springs.minimum) / (1 - less.flops / all_springs.flops)


def _use() -> Iterator[Target]:
    yield Target(
        "double, dt 1e-4 s, 1 thread: times real time",
        "x",
        5.0,
        lambda m: 1e-4 / m.seconds("swing+bend", "edge", "double"),
        False,
        "5",
    )
    yield Target("double, dt 1e-4 s: error after 0.25 s", "m", 1e-10, _accuracy, prototype="2.7e-12")
    yield Target(
        "overhead of a Stepper's call",
        "us",
        1.0,
        lambda m: 1e6 * (m.seconds("2 x 2, a step a call", "edge", "double") - m.seconds("2 x 2", "edge", "double")),
    )
    yield Target("threads=None / the best thread count, worst of 32 x 32 and the grids to 128 x 128", "x", 1.05, _chosen)


def _accuracy(m: Measured) -> float:
    if "edge" not in m.kernels:
        raise Missing("not built yet")
    if not m.accuracy:
        raise Missing("not measured in this run")
    return m.accuracy["edge"]


def _chosen(m: Measured) -> float:
    works = ["swing+bend", *(f"grid {rows}" for rows in m.sizes if rows <= 128)]
    return max(
        m.seconds(work, "edge", precision, None) / min(m.seconds(work, "edge", precision, n) for n in m.threads)
        for work in works
        for precision in ("single", "double")
    )


TARGETS = tuple(target for part in (_steps, _peers, _throughput, _machine, _features, _use) for target in part())

ERRORS = {4e-7: 0.011, 2e-8: 0.015, 1e-12: 0.06}
"""Wall seconds per simulated second to reach at each rms error [m].

The scene is ``paper_swing(bend=True)`` over 0.5 s with two threads. The best peer shall take at least five times as long.
"""


def text(measured: Measured) -> str:
    """Each target with its bound, and its value or why there is none."""
    lines = []
    for one in (target.evaluate(measured) for target in TARGETS):
        bound = f"{'<=' if one['at_most'] else '>='} {one['bound']:.4g} {one['unit']}"
        value = one["missing"] or f"{one['value']:.4g}"
        met = {True: "met", False: "MISSED", None: ""}[one["met"]]
        lines.append((one["target"], bound, value, met, one["prototype"]))
    return aligned(("target", "bound", "measured", "", "prototype"), lines, left=range(5))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Judge saved runs of `clothsim bench` by the targets.")
    parser.add_argument("files", nargs="+", type=Path, metavar="CSV", help="runs that the bench has saved")
    for path in parser.parse_args(arguments).files:
        print(f"{path.name}\n{text(read(path))}\n")


if __name__ == "__main__":
    main()
