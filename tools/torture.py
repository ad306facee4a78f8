"""Run the fuzzers of `tests`, and what kills or interrupts at random, for long: `make torture`.

    python tools/torture.py --minutes 20 --seed 7

A seed at random is printed; the same seed repeats the same rounds. The parts share the time: each has the same part of the
time that is left. A part that does not end in its time is stopped and named, which is no failure.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time

TORTURE = "tests/package/test_torture.py"
PARTS = (
    f"{TORTURE}::test_a_kill_at_any_moment_leaves_a_whole_file_or_the_old_one",
    f"{TORTURE}::test_calls_from_several_threads_give_the_bits_of_one",
    f"{TORTURE}::test_ctrl_c_at_any_moment_leaves_a_whole_step",
    "tests/core/test_abandoned_steps.py",  # Ctrl-C in the middle of a step
    "tests/package/test_extremes.py",
    "tests/core/test_ends.py",
    "tests/core/test_threads.py",  # forks, Ctrl-C
    "tests/sweeps/test_sweep_damage.py",
    "tests/package/test_odd_values.py",
    "tests/base/test_files.py",  # every byte of every file
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--rounds", type=int, default=60, help="times what `make test` does")
    options = parser.parse_args()
    end = time.monotonic() + 60 * options.minutes
    print(f"seed {options.seed}", flush=True)
    environment = {
        "CLOTHSIM_TEST_SEED": str(options.seed),
        "CLOTHSIM_TEST_ROUNDS": str(options.rounds),
        "CLOTHSIM_TEST_FLIPS": str(10**7),
    }
    failed = []
    for k, part in enumerate(PARTS):
        begin = time.monotonic()
        code = _run(part, max(1.0, (end - begin) / (len(PARTS) - k)), environment)
        result = "not done in time" if code is None else f"failed with {code}" if code else "passed"
        print(f"{part}: {result} after {time.monotonic() - begin:.0f} s", flush=True)
        if code:
            failed.append(part)
    sys.exit(f"seed {options.seed}: failed: {', '.join(failed)}" if failed else 0)


def _run(part: str, seconds: float, environment: dict[str, str]) -> int | None:
    """The exit code of a part; None: stopped, with the processes that it has started."""
    command = [sys.executable, "-m", "pytest", "-q", "-m", "not peers", part]
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
