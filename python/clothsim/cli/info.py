"""`clothsim info`: the build of this installation and the machine."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

import clothsim as cs
from clothsim.gpu import adapters

from ..base.files import as_json


def add_arguments(command: argparse.ArgumentParser) -> None:
    """It has none."""


def _adapters() -> Any:
    """Adapters for the backend "gpu", or why there are none."""
    try:
        found = adapters()
    except ImportError as error:
        return str(error)
    return {
        f"{place}: {adapter.name}": {
            "api": adapter.api,
            "kind": adapter.kind + (" (runs shaders, no GPU)" if adapter.software else ""),
            "driver": adapter.driver,
            "float64": adapter.float64,
            "largest_buffer": adapter.largest_buffer,
        }
        for place, adapter in enumerate(found)
    } or "none found"


def run(args: argparse.Namespace) -> None:
    config = {**cs.build_config(), "graphics_adapters": _adapters()}
    print(as_json(config) if args.json else "\n".join(_lines(config)))


def _lines(data: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield f"{indent}{name}:"
            yield from _lines(value, indent + "  ")
        else:
            yield f"{indent}{name}: {', '.join(map(str, value)) if isinstance(value, list) else value}"
