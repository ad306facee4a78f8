"""Limits of this machine, each measured by a loop that does nothing else."""

from __future__ import annotations

from typing import get_args

from .. import _core
from ..base import check
from ..typing import Precision

BYTES_IN_SHARED_CACHE = _core.bytes_in_shared_cache
"""Size of an array above which the core counts each pass over it as memory traffic [bytes]."""


def multiply_add_peak(precision: Precision = "double", threads: int = 1) -> float:
    """The rate of independent multiply-adds in registers, a multiply-add counting as two operations.

    Parameters
    ----------
    precision : {"double", "single"}, default "double"
    threads : int, default 1

    Returns
    -------
    float
        Operations of all threads together [1/s], the best of several windows. The instruction set is that of
        `build_config`.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> from clothsim.machine import multiply_add_peak
    >>> multiply_add_peak("single") > 1e8
    True
    """
    check.choice("precision", precision, get_args(Precision))
    return _core.multiply_add_peak(precision, _threads(threads))


def memory_bandwidth(threads: int = 1, size: int = 1 << 29) -> dict[str, float]:
    """Bytes per second that the threads read and write in arrays of one size.

    Parameters
    ----------
    threads : int, default 1
    size : int, default 512 MiB
        Bytes of the arrays together, at least 4096. An array within a cache measures that cache.

    Returns
    -------
    dict
        "update": of an array that is updated in place, as a step does; "triad": of STREAM's triad a = b + s c
        (McCalpin 1995) [B/s].

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> from clothsim.machine import memory_bandwidth
    >>> sorted(memory_bandwidth(1, 1 << 14))
    ['triad', 'update']
    """
    return _core.memory_bandwidth(_threads(threads), check.integer("size", size, minimum=4096))


def core_round_trip() -> float:
    """Time in which one core signals another and hears back [s]; it bounds the gain of threads on small cloths.

    Examples
    --------
    >>> from clothsim.machine import core_round_trip
    >>> core_round_trip() > 0
    True
    """
    return _core.core_round_trip()


def _threads(threads: int) -> int:
    return check.integer("threads", threads, minimum=1, maximum=_core.most_threads)
