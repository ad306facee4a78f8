"""What a team of threads costs beside other busy processes, as a multiple of one thread.

    python benchmarks/busy.py              # beside two busy processes
    python benchmarks/busy.py --busy 0     # on the machine as it is

Parts with one thread and with a team take turns in one process, so that what else the machine does falls on both. The
ratio is that of the sums: a part that waits for a taken processor is late, and must count.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from time import process_time

import clothsim as cs
from common import Stopwatch, turns

MOST_RATIO = 1.5
SHAPES = ((32, 32), (64, 64), (200, 200))
PART = 0.05  # least processor time of a part with one thread [s]


def ratio(shape: tuple[int, int], kernel: str, threads: int, rounds: int) -> float:
    """Seconds of the team over those of one thread, of all parts together."""
    scene = cs.Scene(cs.Cloth(shape))
    dt = 0.5 * cs.max_stable_dt(scene)
    steppers = [cs.Stepper(scene, threads=count, kernel=kernel) for count in (1, threads)]
    steps, spent = 16, 0.0
    while spent < PART:
        steps *= 2
        start = process_time()
        steppers[0].advance(steps, dt)
        spent = process_time() - start
    seconds = [0.0, 0.0]
    for which in turns(2, rounds):
        with Stopwatch() as watch:
            steppers[which].advance(steps, dt)
        seconds[which] += watch.seconds
    return seconds[1] / seconds[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--busy", type=int, default=2, help="processes that do nothing but count")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.busy)]
    try:
        print("| cloth | kernel | team over one thread | at most |")
        print("| --- | --- | --- | --- |")
        for shape in SHAPES:
            for kernel in ("edge", "gather"):
                found = ratio(shape, kernel, options.threads, options.rounds)
                print(f"| {shape[0]} x {shape[1]} | {kernel} | {found:.2f} | {MOST_RATIO} |", flush=True)
    finally:
        for other in others:
            other.kill()


if __name__ == "__main__":
    main()
