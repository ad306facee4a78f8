"""This machine: where numbers come from, and its limits of arithmetic and memory. See docs/benchmarks.md."""

from .capacity import BYTES_IN_SHARED_CACHE, core_round_trip, memory_bandwidth, multiply_add_peak
from .origin import processor, provenance

__all__ = ["BYTES_IN_SHARED_CACHE", "core_round_trip", "memory_bandwidth", "multiply_add_peak", "processor", "provenance"]
