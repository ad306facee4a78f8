"""The report as text and JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..base.files import write_bytes
from ..base.plain_json import as_json
from ..base.table import aligned
from . import published as paper
from .paper_tables import tables

WIDTH = 100


def headline(report: dict[str, Any]) -> list[str]:
    """Version, machine and date, a line each."""
    origin = report["provenance"]
    build, machine = origin["build"], origin["machine"]
    return [
        f"clothsim {build['version']}, {build['instruction_set']}, {build['compiler']}",
        f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}",
        origin["created"],
    ]


def text(report: dict[str, Any]) -> str:
    """The whole report as plain text."""
    lines = ["The experiments of Kim et al., run by clothsim", "=" * 46, *headline(report), ""]
    if report["reductions"]:
        lines += ["Shorter than the full reproduction:", *_items(report["reductions"]), ""]
    lines += ["Variants of the collision response:"]
    lines += _items(f"{name}: {meaning}" for name, meaning in paper.VARIANTS.items())
    for number, experiment in report["experiments"].items():
        title = f"Experiment {number}: {experiment['title']}"
        lines += ["", title, "-" * len(title), *_wrapped(experiment["setting"])]
        for table in tables(number, experiment):
            lines += [
                "",
                *([table.caption] if table.caption else []),
                aligned(table.headings, table.rows, (), rule=True, stacked=True),
            ]
        lines.append("")
        lines += [*_wrapped(f"The paper: {experiment['paper']}"), *_items(experiment["notes"])]
    return "\n".join(lines) + "\n"


def _wrapped(paragraph: str) -> list[str]:
    return textwrap.wrap(paragraph, WIDTH)


def _items(entries: Iterable[str]) -> list[str]:
    lines = []
    for entry in entries:
        lines += textwrap.wrap(entry, WIDTH, initial_indent="- ", subsequent_indent="  ")
    return lines


def write(report: dict[str, Any], folder: Path) -> None:
    """Write report.txt and report.json into `folder`."""
    write_bytes(folder / "report.txt", text(report).encode())
    write_bytes(folder / "report.json", (as_json(report) + "\n").encode())
