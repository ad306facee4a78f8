"""What several subcommands share."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import Any


def add_command(subparsers: Any, name: str, function: Any, text: str) -> argparse.ArgumentParser:
    """A subparser that calls `function` with the parsed arguments; it takes --json."""
    command: argparse.ArgumentParser = subparsers.add_parser(name, help=text, description=text)
    command.set_defaults(run=function, command=name, parser=command)
    command.add_argument("--json", action="store_true", help="print JSON instead of text")
    return command


def count(text: str) -> int:
    """An argument that is a whole number >= 1."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number >= 1, got {text!r}")
    return value


def refuse_ignored(args: argparse.Namespace, flag: str, options: Iterable[str]) -> None:
    """Raise ValueError if one of the options is given that `flag` would ignore."""
    for option in options:
        name = option.lstrip("-").lower()
        if getattr(args, name) != args.parser.get_default(name):
            raise ValueError(f"{option} does not go with {flag}, which would ignore it")


def as_text(data: Mapping[str, Any], indent: str = "") -> str:
    """One `name: value` line per entry, the values aligned; mappings inside are indented."""
    width = max(map(len, data), default=0)
    lines = []
    for name, value in data.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{name}:", as_text(value, indent + "  ")]
        else:
            shown = ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else value
            lines.append(f"{indent}{name + ':':<{width + 1}} {shown}")
    return "\n".join(lines)
