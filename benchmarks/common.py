"""Helpers of several benchmarks: a stopwatch, tables of text, and what they were measured on."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Collection, Iterable, Sequence
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Any

import clothsim as cs


class Stopwatch:
    """A context whose attribute `seconds` is how long it took."""

    seconds: float

    def __enter__(self) -> Stopwatch:
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.seconds = perf_counter() - self._start


def aligned(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    indent: str = "",
    rule: bool = True,
) -> str:
    """Return a table of columns as wide as their widest cell; those of `left` are aligned left."""
    body = [*([head] if head else []), *rows]
    widths = [max(map(len, column)) for column in zip(*body, strict=True)]
    if head and rule:
        body.insert(1, ["-" * width for width in widths])
    sides = ["<" if k in left else ">" for k in range(len(widths))]
    cells = (
        [f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths)] for row in body
    )
    return "\n".join(indent + "  ".join(row).rstrip() for row in cells)


def short(value: Any, unit: str = "") -> str:
    """Return a value for people: four digits, thousands apart, and its unit."""
    if value is None or isinstance(value, (bool, str)):
        return {None: "", True: "yes", False: "no"}.get(value, value)
    text = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
    return f"{text} {unit}".rstrip()


def conditions(packages: Sequence[str] = ()) -> str:
    """Machine, load and versions, for the line under a table."""
    config = cs.build_config()
    cpuinfo = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*: (.*)", cpuinfo.read_text() if cpuinfo.exists() else "")
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    versions = [f"{name} {config[name]}" for name in ("python", "numpy")]
    versions += [
        f"{package.metadata['Name']} {package.version}"
        for package in map(_distribution, packages)
        if package
    ]
    machine = (
        f"{model.group(1) if model else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()}, {load}"
    )
    return (
        f"{machine}; clothsim {config['version']} ({config['instruction_set']}), "
        f"{', '.join(versions)}"
    )


def _distribution(name: str) -> metadata.Distribution | None:
    try:
        return metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return None
