"""Helpers of several subcommands."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base.table import aligned
from ..methods.data import integrator_name
from ..run.frames import EVERY_STEP, checked_every

COMMANDS = {
    "info": "Print version, compiler, instruction sets, threads, libraries and graphics adapters.",
    "run": "Simulate a scene and print its report.",
    "scene": "Print a scene as the text of a scene file, to edit.",
    "live": "Write a page that simulates a scene in the browser, by WebGPU.",
    "export": "Write a saved run as files for Blender, ParaView, browsers.",
    "sweep": "Run a scene for every combination of values, and label the results.",
    "plot": "Draw a stored sweep or a saved run.",
    "stability": "Map which time steps are stable at which stiffness, predicted and measured, or run the hard cases.",
    "work-precision": "Measure error against wall time for integrators, precisions and steps or tolerances.",
    "reproduce": "Run the experiments of Kim et al. and write a report.",
}
"""The help of every command, in the order of `clothsim --help`; each is a module of this package."""

MODULES = {"scene": "print_scene", "live": "write_live"}
"""Modules that cannot have the name of their command, because a module of another room has it."""

SCRIPTS = {"bench": "python benchmarks/bench", "contact": "python benchmarks/contact", "--peers": "python benchmarks/peers"}
"""Commands and options of an earlier version, and the script of a clone that does their work."""

EVERY_HELP = (
    "store a frame every N steps (whole number from 2), every S seconds (with a point or "
    "exponent), or at each step (step); default: first and last only"
)


class Narrow(argparse.HelpFormatter):
    """Help of at most 80 columns, also in a wide terminal."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(80, shutil.get_terminal_size().columns) - 2)


def add_command(subparsers: Any, name: str, function: Any) -> argparse.ArgumentParser:
    """A subparser that calls `function` with the parsed arguments; it takes --json."""
    command: argparse.ArgumentParser = subparsers.add_parser(
        name, help=COMMANDS[name], description=COMMANDS[name], formatter_class=Narrow
    )
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


def integrator(text: str) -> str:
    """An argument that names an integrator."""
    try:
        return integrator_name(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error).partition(" ")[2]) from None


def written(files: Sequence[Path]) -> str:
    """A line that names the written files."""
    more = f" and {len(files) - 1} more beside it" if len(files) > 1 else ""
    return f"Written: {files[0]}{more}"


def every(text: str) -> int | float | str:
    """An argument that `simulate` and `sweep` take as `every`."""
    if text == EVERY_STEP:
        return text
    try:
        value = int(text) if text.lstrip("+-").isdigit() else float(text)
        checked_every(value)
    except ValueError:
        hint = "; for each step give step, for each second 1.0" if text == "1" else ""
        raise argparse.ArgumentTypeError(
            f"must be a whole number of steps >= 2, seconds > 0 (with a point or exponent) or 'step', got {text!r}{hint}"
        ) from None
    return value


def refuse_ignored(args: argparse.Namespace, flag: str, options: Iterable[str]) -> None:
    """Raise ValueError if an option is given that `flag` would ignore."""
    for option in options:
        name = option.lstrip("-").lower()
        if getattr(args, name) != args.parser.get_default(name):
            raise ValueError(f"{option} does not go with {flag}, which would ignore it")


def as_text(data: Mapping[str, Any]) -> str:
    """One `name: value` line per entry, the values aligned; mappings inside are indented."""
    return aligned((), list(_entries(data, "")), left=(0, 1))


def _entries(data: Mapping[str, Any], indent: str) -> Iterator[tuple[str, str]]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield f"{indent}{name}:", ""
            yield from _entries(value, indent + "  ")
        else:
            yield f"{indent}{name}:", ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def as_table(data: Mapping[str, Any], units: Mapping[str, str], indent: str = "") -> str:
    """One line per entry: its name in words, and its value in four digits with its unit.

    A mapping of plain values takes one line. A unit is looked up by the entry's own name, then by that of the mapping
    it is in. An unknown number gives way to the "reason" of its mapping.

    Examples
    --------
    >>> data = {"steps": 12000, "energy": {"start": 0.0, "end": 1.23456789}, "penetration":
    ...         {"points": float("nan"), "reason": "no sphere"}}
    >>> print(as_table(data, {"energy": "J", "penetration": "m"}))
    steps        12,000
    energy       start 0 J, end 1.235 J
    penetration  no sphere
    """
    return aligned((), list(_rows(data, units, "", "")), left=(0, 1), indent=indent)


def _rows(data: Mapping[str, Any], units: Mapping[str, str], unit: str, before: str) -> Iterator[tuple[str, str]]:
    for key, value in data.items():
        name = before + key.replace("_", " ")
        own = units.get(key, unit)
        if not isinstance(value, Mapping):
            yield name, short(value, own)
            continue
        reason = value.get("reason")
        entries = {entry: number for entry, number in value.items() if entry != "reason"}
        unknown = [entry for entry, number in entries.items() if number is None or number != number] if reason else []
        if any(isinstance(entry, Mapping) for entry in entries.values()):
            yield from _rows(
                {e: reason if e in unknown else number for e, number in entries.items()}, units, own, f"{name}, "
            )
            continue
        texts = [
            f"{entry.replace('_', ' ')} {short(number, units.get(entry, own))}"
            for entry, number in entries.items()
            if entry not in unknown
        ]
        yield name, ", ".join(texts) + (f" ({reason})" if texts and reason else "") or str(reason or "none")


def short(value: Any, unit: str = "") -> str:
    """A value for people: four digits, thousands apart, and its unit."""
    if value in (None, "", []):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (list, tuple)):
        texts = (f"({short(entry)})" if isinstance(entry, list) else short(entry) for entry in value)
        return ", ".join(texts) + (f" {unit}" if unit else "")
    if not isinstance(value, (int, float)):
        return str(value)
    if value != value:
        return "unknown"
    text = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
    return f"{text} {unit}" if unit else text
