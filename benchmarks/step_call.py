"""What a call with arrays in and arrays out costs beside the steps it asks for; docs/dev/step-call.md quotes the table.

    python benchmarks/step_call.py              # one thread
    python benchmarks/step_call.py --threads 2

`cs.step` of one step and `Stepper.advance(1)` take turns in one process, and the minimum of each counts: what
else the machine does then falls on both, and least on either.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import clothsim as cs
import numpy as np

DT = 5e-6
# Of a call of `step`: times the step, and microseconds. Of `acceleration` and of a first call: microseconds.
MOST_RATIO, MOST_ADDED, MOST_ACCELERATION, MOST_FIRST = 1.4, 5.0, 12.0, 1000.0
MEMBERS = 64


def least(*calls: Callable[[], Any], seconds: float) -> list[float]:
    """Microseconds of each call: the least mean of a few calls in a row, one kind after the other."""
    best, count = [float("inf")] * len(calls), 1
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        for k, call in enumerate(calls):
            start = time.perf_counter()
            for _ in range(count):
                call()
            best[k] = min(best[k], (time.perf_counter() - start) / count * 1e6)
        count = max(1, int(2e3 / max(best)))
    return best


def state(scene: cs.Scene) -> tuple[np.ndarray, np.ndarray]:
    """The scene in motion: the first steps, when nothing moves, are no others, but look so."""
    return cs.step(scene, scene.initial_position, scene.initial_velocity, 1e-4, 1000)


def single_calls(threads: int | None, seconds: float) -> list[dict[str, Any]]:
    scene = cs.scenes.paper_swing()
    x, v = state(scene)
    out, a = (np.empty_like(x), np.empty_like(x)), np.empty_like(x)
    rows = []
    for precision in ("double", "single"):
        stepper = cs.Stepper(scene, precision=precision, threads=threads)
        options = {"precision": precision, "threads": threads}

        def call(options=options):
            cs.step(scene, x, v, DT, out=out, **options)

        def accelerate(options=options):
            cs.acceleration(scene, x, v, out=a, **options)

        call_us, step_us, acceleration_us = least(call, lambda s=stepper: s.advance(1, DT), accelerate, seconds=seconds)
        rows.append(of_step(f"step, {precision}", call_us, step_us))
        rows.append({"call": f"acceleration, {precision}", "us": acceleration_us, "limit_us": MOST_ACCELERATION})
    return rows


def batch_calls(threads: int | None, seconds: float) -> list[dict[str, Any]]:
    scenes = [cs.scenes.paper_swing().replace(gravity=(0, -9 - k / MEMBERS, 0)) for k in range(MEMBERS)]
    x, v = (np.stack([part] * MEMBERS) for part in state(scenes[0]))
    out = np.empty_like(x), np.empty_like(x)
    rows = []
    for precision in ("double", "single"):
        stepper = cs.Stepper(scenes, x, v, precision=precision, threads=threads)
        call_us, step_us = least(
            lambda p=precision: cs.step(scenes, x, v, DT, out=out, precision=p, threads=threads),
            lambda s=stepper: s.advance(1, DT),
            seconds=seconds,
        )
        rows.append(of_step(f"step, batch of {MEMBERS}, {precision}", call_us, step_us))
    return rows


def of_step(name: str, call_us: float, step_us: float) -> dict[str, Any]:
    return {"call": name, "us": call_us, "step_us": step_us, "limit_us": MOST_RATIO * step_us + MOST_ADDED}


def first_calls(threads: int | None, count: int = 20) -> dict[str, Any]:
    best = float("inf")
    for k in range(count):
        scene = cs.scenes.paper_swing().replace(gravity=(0, -9 - k / count, 0))
        x, v = scene.initial_position, scene.initial_velocity
        start = time.perf_counter()
        cs.step(scene, x, v, DT, threads=threads)
        best = min(best, time.perf_counter() - start)
    return {"call": "step, first of a scene", "us": best * 1e6, "limit_us": MOST_FIRST}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=2.0, help="for each precision of each kind of call")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    threads = options.threads or None
    rows = [*single_calls(threads, options.seconds), *batch_calls(threads, options.seconds), first_calls(threads)]
    if options.json:
        print(json.dumps(rows))
        return
    print("| call | us | a step, us | ratio | at most, us | |")
    print("| --- | --- | --- | --- | --- | --- |")
    for row in rows:
        step = row.get("step_us")
        beside = f"{step:.1f} | {row['us'] / step:.2f}" if step else "|"
        verdict = "" if row["us"] <= row["limit_us"] else "above"
        print(f"| {row['call']} | {row['us']:.1f} | {beside} | {row['limit_us']:.1f} | {verdict} |")


if __name__ == "__main__":
    main()
