"""`clothsim info`: the build of this installation and the machine."""

from __future__ import annotations

import argparse
from typing import Any

import clothsim as cs
from clothsim.gpu import adapters

from ..base.plain_json import as_json
from ._common import add_command, as_text


def add_parser(subparsers: Any) -> None:
    add_command(subparsers, "info", run)


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
    print(as_json(config) if args.json else as_text(config))
