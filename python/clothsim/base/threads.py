"""How many threads there are."""

import os


def available_threads() -> int:
    """The processors that this process may use, at most `OMP_NUM_THREADS`."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return min(count, int(limit)) if limit.isdecimal() and int(limit) > 0 else count
