"""Helpers of several benchmarks: values as text, and what they were measured on."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import clothsim as cs


def short(value: Any, unit: str = "") -> str:
    """A value for people: four digits, thousands apart, and its unit."""
    if value is None or isinstance(value, (bool, str)):
        return {None: "", True: "yes", False: "no"}.get(value, value)
    text = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
    return f"{text} {unit}".rstrip()


def conditions(packages: Sequence[str] = ()) -> str:
    """Machine, load and versions, for the line under a table."""
    config, cpuinfo = cs.build_config(), Path("/proc/cpuinfo")
    named = re.search(r"model name\s*: (.*)", cpuinfo.read_text() if cpuinfo.exists() else "")
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    versions = [f"{name} {config[name]}" for name in ("python", "numpy")]
    versions += [f"{one.metadata['Name']} {one.version}" for one in map(_distribution, packages) if one]
    machine = f"{named.group(1) if named else platform.machine()}, {os.cpu_count()} cores, {platform.system()}, {load}"
    return f"{machine}; clothsim {config['version']} ({config['instruction_set']}), {', '.join(versions)}"


def _distribution(name: str) -> metadata.Distribution | None:
    try:
        return metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return None
