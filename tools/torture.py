"""Run the fuzzers of `tests` for longer than `make test` does: `make torture`.

    python tools/torture.py --minutes 20 --seed 7

A seed at random is printed; the same seed repeats the same rounds. Each part has the time that is left. A part that does
not end in time is stopped and named, which is no failure.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time

PARTS = (
    "tests/package/test_torture.py",  # kills, memory limits, threads
    "tests/package/test_odd_values.py",
    "tests/package/test_extremes.py",
    "tests/core/test_ends.py",
    "tests/core/test_threads.py",  # forks, Ctrl-C
    "tests/base/test_files.py",  # every byte of every file
    "tests/sweeps/test_sweep_damage.py",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--rounds", type=int, default=20, help="times what `make test` does")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    print(f"seed {options.seed}", flush=True)
    environment = {
        "CLOTHSIM_TEST_SEED": str(options.seed),
        "CLOTHSIM_TEST_ROUNDS": str(options.rounds),
        "CLOTHSIM_TEST_FLIPS": str(10**7),
    }
    failed = []
    for part in PARTS:
        command = [sys.executable, "-m", "pytest", "-q", "-m", "not peers", part]
        try:
            run = subprocess.run(command, env={**os.environ, **environment}, timeout=max(1.0, end - time.monotonic()))
        except subprocess.TimeoutExpired:
            print(f"{part}: not done in time", flush=True)
            continue
        if run.returncode:
            failed.append(part)
    sys.exit(f"seed {options.seed}: failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
