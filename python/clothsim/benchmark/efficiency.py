"""What a step does and moves, beside the machine's limits."""

from __future__ import annotations

from typing import Any

from .figures import Missing
from .targets import Measured, share_of_peak

_BYTES = {"single": 96, "double": 96}
"""Least memory traffic of a point-step: state read and written once. 6 components and, in single,
as many compensations."""


def efficiency(measured: Measured) -> list[dict[str, Any]]:
    """Flops, share of the peak, least traffic and bound of each kernel: 5,826 springs, 1 thread."""
    rows = []
    for by in measured.kernels:
        for precision in ("single", "double"):
            try:
                share = share_of_peak(measured, by, precision)
                seconds = measured.seconds("swing+bend", by, precision)
            except Missing:
                continue
            flops, points = measured.flops("swing+bend", by, precision), 32 * 32
            peak = measured.limits["peak"][measured.instruction_sets[0], precision, 1]
            arithmetic = flops / points / peak
            memory = _BYTES[precision] / measured.limits["bandwidth"][1]
            rows.append(
                {
                    "kernel": by,
                    "precision": precision,
                    "flops_per_step": flops,
                    "flops_per_second": flops / seconds,
                    "share_of_peak": share,
                    "bytes_per_point_step": _BYTES[precision],
                    "arithmetic_seconds_per_point": arithmetic,
                    "memory_seconds_per_point": memory,
                    "bound": "arithmetic" if arithmetic > memory else "memory",
                }
            )
    return rows
