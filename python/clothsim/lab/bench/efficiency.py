"""Operations and traffic of a step, beside the machine's limits."""

from __future__ import annotations

from typing import Any

from clothsim.machine import BYTES_IN_SHARED_CACHE

from .figures import Missing
from .measured_run import Measured, share_of_peak

STATE_TRAFFIC = 96
"""Bytes of a point-step that reads and writes the state once: six components of 8 bytes or, in
single, six of 4 and as many compensations."""

# The gather kernel sweeps the whole cloth once a stage (cpp/engines/gather_engine.cpp). Counted
# are the values of a point in each array that a stage touches (`finish_stage` in
# cpp/kernels/gather/gather_impl.hpp): once fetched, also where it is only written, since a store fetches
# its line, and once written back if it is written. Neighbours lie in rows that are still in cache.
#
#   stage   fetched                                              written back
#   first   state 6, stage a 6, first acceleration 3       15    a, first acceleration      9
#   second  a 6, state 6, b 6, acceleration sum 3          21    b, acceleration sum        9
#   third   b 6, state 6, a 6, acceleration sum 3          21    a, acceleration sum        9
#   fourth  a 6, state 6, both accelerations 6             18    state                      6
#
# That is 108 values; in single the fourth stage also fetches and writes 6 compensations.
_GATHER_TRAFFIC = {"single": 120 * 4, "double": 108 * 8}


def traffic(kernel: str, precision: str) -> int:
    """Bytes that a point-step of a cloth larger than the caches reads and writes at least."""
    return _GATHER_TRAFFIC[precision] if kernel == "gather" else STATE_TRAFFIC


def efficiency(measured: Measured) -> list[dict[str, Any]]:
    """Each kernel's time beside its limits: 32 x 32 on one thread, 1024 x 1024 on all.

    Returns
    -------
    list of dict
        "work", "kernel", "precision", "threads", "flops_per_step", "flops_per_second",
        "share_of_peak", "bytes_per_point_step"; [s] of a point-step: "seconds_per_point" measured,
        "arithmetic_seconds_per_point" and "memory_seconds_per_point" at the limits;
        "through_memory": whether those bytes go through memory, or the cloth stays in cache;
        "bound": the larger limit of those that hold.
    """
    rows = []
    for work, threads in (("swing+bend", 1), ("grid 1024", measured.threads[-1])):
        for kernel in measured.kernels:
            for precision in ("single", "double"):
                try:
                    rows.append(_row(measured, work, kernel, precision, threads))
                except Missing:
                    continue
    return rows


def _row(m: Measured, work: str, kernel: str, precision: str, threads: int) -> dict[str, Any]:
    share = share_of_peak(m, kernel, precision, work, threads)
    figure = m.figure(work, kernel, precision, threads)
    assert figure.flops is not None  # counted for the kernels of the core
    rate = figure.flops / figure.minimum
    measured = figure.minimum / figure.points
    moved = traffic(kernel, precision)
    memory = moved / m.limits["bandwidth"][threads]
    through_memory = figure.points * STATE_TRAFFIC / 2 > BYTES_IN_SHARED_CACHE
    return {
        "work": work,
        "kernel": kernel,
        "precision": precision,
        "threads": threads,
        "flops_per_step": figure.flops,
        "flops_per_second": rate,
        "share_of_peak": share,
        "bytes_per_point_step": moved,
        "seconds_per_point": measured,
        "arithmetic_seconds_per_point": measured * share,
        "memory_seconds_per_point": memory,
        "through_memory": through_memory,
        "bound": "memory" if through_memory and memory > measured * share else "arithmetic",
    }
