"""Provenance of numbers: the build, the machine and the time."""

from __future__ import annotations

import os
import platform
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from .build import build_config


def provenance() -> dict[str, Any]:
    """The build, the machine and the time that numbers belong to.

    Returns
    -------
    dict
        "created" (UTC, ISO 8601), "build" (see `clothsim.build_config`) and "machine", which has
        what `processor` gives, "cores" and "system".

    Examples
    --------
    >>> from clothsim.machine import provenance
    >>> sorted(provenance())
    ['build', 'created', 'machine']
    """
    return {
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "build": build_config(),
        "machine": {**processor(), "cores": os.cpu_count(), "system": f"{platform.system()} {platform.machine()}"},
    }


def processor() -> dict[str, Any]:
    """The processor's name, with the numbers that distinguish processors of equal name.

    Returns
    -------
    dict
        "cpu" (str); "family", "model" and "stepping" (int), None where the system does not tell.

    Examples
    --------
    >>> from clothsim.machine import processor
    >>> sorted(processor())
    ['cpu', 'family', 'model', 'stepping']
    """
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    entries: dict[str, str] = {}
    for key, _, value in (line.partition(":") for line in lines):
        entries.setdefault(key.strip(), value.strip())

    def number(key: str) -> int | None:
        return int(entries[key]) if entries.get(key, "").isdecimal() else None

    return {
        "cpu": entries.get("model name") or platform.processor() or platform.machine(),
        "family": number("cpu family"),
        "model": number("model"),
        "stepping": number("stepping"),
    }
