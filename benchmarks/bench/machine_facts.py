"""The machine of a benchmark: its name, its load, and its limits on several threads and instruction sets."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import clothsim as cs
from clothsim import machine as this_machine

# Larger than any last-level cache's share of this process, small enough for any machine.
_MEMORY_BYTES = 1 << 29
_CACHE_BYTES = 1 << 14


@contextmanager
def instruction_set(name: str) -> Iterator[None]:
    """Let steppers that are made inside this context use this instruction set."""
    before = os.environ.get("CLOTHSIM_ISA")
    os.environ["CLOTHSIM_ISA"] = name
    try:
        yield
    finally:
        if before is None:
            del os.environ["CLOTHSIM_ISA"]
        else:
            os.environ["CLOTHSIM_ISA"] = before


def describe() -> dict[str, Any]:
    """Processor, cores, system, load average, build and time."""
    origin = this_machine.provenance()
    load = os.getloadavg() if hasattr(os, "getloadavg") else None
    machine = {**origin["machine"], "cores": int(cs.build_config()["openmp_threads"])}
    return {**machine, "load_average": load, "created": origin["created"], "build": origin["build"]}


def slug(machine: dict[str, Any]) -> str:
    """A file name for this kind of machine. Family and model distinguish processors of equal name."""
    kind = [f"{key} {machine[key]}" for key in ("family", "model") if machine[key] is not None]
    words = [machine["cpu"], *kind, f"{machine['cores']} cores", machine["build"]["instruction_set"]]
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\((r|tm)\)", "", " ".join(words).lower())).strip("-")


def limits(instruction_sets: tuple[str, ...], threads: tuple[int, ...]) -> dict[str, Any]:
    """Peak arithmetic, memory bandwidth and the cores' round trip.

    Parameters
    ----------
    instruction_sets : tuple of str
        Instruction sets, the best first. Bandwidth is measured with the first.
    threads : tuple of int

    Returns
    -------
    dict
        "peak", {(instruction set, precision, threads): flop/s, a multiply-add being two};
        "bandwidth", {threads: B/s}, read and written by an in-place update of 512 MiB; "triad",
        the same for STREAM's triad; "cache_bandwidth", {threads: B/s} within 16 KiB;
        "round_trip", s from one core to another and back, None on one core.
    """
    peak = {}
    for name in instruction_sets:
        with instruction_set(name):
            for precision in ("single", "double"):
                for count in threads:
                    peak[name, precision, count] = this_machine.multiply_add_peak(precision, count)
    with instruction_set(instruction_sets[0]):
        memory = {count: this_machine.memory_bandwidth(count, _MEMORY_BYTES) for count in threads}
        cache = {count: this_machine.memory_bandwidth(count, _CACHE_BYTES) for count in threads}
    return {
        "peak": peak,
        "bandwidth": {count: one["update"] for count, one in memory.items()},
        "triad": {count: one["triad"] for count, one in memory.items()},
        "cache_bandwidth": {count: one["update"] for count, one in cache.items()},
        "round_trip": this_machine.core_round_trip() if max(threads) > 1 else None,
    }


def as_plain(measured: dict[str, Any]) -> dict[str, Any]:
    """`limits` with the peak as a list of rows, as JSON needs it."""
    if not measured:
        return {}
    names = ("instruction_set", "precision", "threads")
    rows = [dict(zip(names, key, strict=True), flops_per_second=rate) for key, rate in measured["peak"].items()]
    return {**measured, "peak": rows}
