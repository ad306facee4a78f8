"""Run the tests that kill or interrupt at random, and the longest fuzzers: `make torture`.

    python tools/torture.py --minutes 20 --seed 7

A seed at random is printed; the same seed repeats the same rounds. The parts share the time: each
has the same part of the time that is left. A part that does not end in its time is stopped and
named, which is no failure.
"""

from __future__ import annotations

import argparse
import os
import random
import shlex
import signal
import subprocess
import sys
import time

PARTS = (
    "tests/package/test_torture.py -k kill",
    "tests/package/test_torture.py -k threads",
    "tests/package/test_torture.py -k ctrl_c",
    "tests/sweeps/test_sweep_executors.py -k 'breaks or loses'",
    "tests/base/test_files.py -k damage",  # every byte of every file
)
RESULTS = {None: "not over in time", 0: "passed"}  # by exit code


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--rounds", type=int, default=60, help="of each test")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    print(f"seed {options.seed}", flush=True)
    environment = {
        "CLOTHSIM_TEST_SEED": str(options.seed),
        "CLOTHSIM_TEST_ROUNDS": str(options.rounds),
        "CLOTHSIM_TEST_FLIPS": str(10**7),
    }
    failures = []
    for k, part in enumerate(PARTS):
        begin = time.monotonic()
        code = _run(part, max(1.0, (end - begin) / (len(PARTS) - k)), environment)
        result = RESULTS.get(code, f"failed with {code}")
        print(f"{part}: {result} after {time.monotonic() - begin:.0f} s", flush=True)
        if code:
            failures.append(part)
    sys.exit(f"seed {options.seed}: failed: {', '.join(failures)}" if failures else 0)


def _run(part: str, seconds: float, environment: dict[str, str]) -> int | None:
    """Run a part; return its exit code, or None where it was stopped with its processes."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-m",
        "torture or not torture",
        *shlex.split(part),
    ]
    process = subprocess.Popen(command, env={**os.environ, **environment}, start_new_session=True)
    try:
        return process.wait(seconds)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        return None


if __name__ == "__main__":
    main()
