"""Helpers of several benchmarks: a line of progress, tables of text, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np


class Progress:
    """A line on stderr that says what is measured and how much is done; nothing in a pipe or a file."""

    def __init__(self, unit: str) -> None:
        self.unit, self.done, self.text = unit, 0, ""
        self.shown = sys.stderr.isatty()

    def say(self, text: str) -> None:
        """Name the work that begins."""
        self.text = text
        self.advance(0)

    def advance(self, count: int = 1) -> None:
        """Count finished work."""
        self.done += count
        if self.shown:
            print(f"\r\033[K{self.text}: {self.done} {self.unit}", end="", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Erase the line."""
        if self.shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


class Stopwatch:
    """A context whose attribute `seconds` is how long it took."""

    seconds: float

    def __enter__(self) -> Stopwatch:
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.seconds = perf_counter() - self._start


def aligned(
    head: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[int] = (0,), indent: str = "", rule: bool = True
) -> str:
    """A table whose columns are as wide as their widest cell; the columns of `left` are aligned left."""
    body = [*([head] if head else []), *rows]
    widths = [max(map(len, column)) for column in zip(*body, strict=True)]
    if head and rule:
        body.insert(1, ["-" * width for width in widths])
    sides = ["<" if k in left else ">" for k in range(len(widths))]
    cells = ([f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths)] for row in body)
    return "\n".join(indent + "  ".join(row).rstrip() for row in cells)


def short(value: Any, unit: str = "") -> str:
    """A value for people: four digits, thousands apart, and its unit."""
    if value is None or isinstance(value, (bool, str)):
        return {None: "", True: "yes", False: "no"}.get(value, value)
    text = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
    return f"{text} {unit}".rstrip()


def as_json(data: Any) -> str:
    """`data` as JSON for any reader: a number that is not finite becomes null."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {str(key): plain(one) for key, one in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(one) for one in value]
        if isinstance(value, (np.ndarray, np.generic)):
            return plain(value.tolist())
        if isinstance(value, float):
            return value if np.isfinite(value) else None
        return value if value is None or isinstance(value, (bool, int)) else str(value)

    return json.dumps(plain(data), indent=1, allow_nan=False)
