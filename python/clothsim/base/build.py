"""Where numbers come from: the build of this package, the machine and the time."""

from __future__ import annotations

import os
import platform
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core


def processor_count() -> int:
    """Count the processors that this process may use."""
    return _core.processors()


def available_thread_count() -> int:
    """Count the processors that this process may use, at most `OMP_NUM_THREADS`."""
    return _core.available_threads()


def build_config() -> dict[str, Any]:
    """Return the build of clothsim, and its settings on this machine.

    Returns
    -------
    dict
        "version", "compiler", "build_type", "flags", "kernel_flags" (per instruction set),
        "instruction_sets_built", "instruction_sets_supported" (of this processor),
        "instruction_set" (the one used; the environment variable CLOTHSIM_ISA overrides it),
        "threads" (available to this process), "openmp" (the runtime and the version that it was
        built for; None: calls have one thread), "eigen", "xsimd", "python" and "numpy" (versions).

    Examples
    --------
    >>> config = cs.build_config()
    >>> config["instruction_set"] in config["instruction_sets_supported"]
    True
    """
    return {
        **_core.build_facts(),
        "instruction_set": _core.choose_instruction_set(),
        "threads": available_thread_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def provenance() -> dict[str, Any]:
    """Return the time, the build and the machine that numbers belong to."""
    machine = {
        "cpu": _processor_name(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
    }
    return {
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "build": build_config(),
        "machine": machine,
    }


def _processor_name() -> str:
    """Return the processor's name; on Linux with the numbers that tell equal names apart."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().split("\n\n")[0].splitlines() if cpuinfo.exists() else []
    pairs = [line.partition(":") for line in lines]
    facts = {key.strip(): value.strip() for key, _, value in pairs}
    name = facts.get("model name") or platform.processor() or platform.machine()
    numbers = [f"{key} {facts[key]}" for key in ("cpu family", "model", "stepping") if key in facts]
    return ", ".join([name, *numbers])
