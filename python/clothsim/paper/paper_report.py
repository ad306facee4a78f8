"""The report's numbers as tables of strings, and the report as text and JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..base.files import write_bytes
from ..base.plain_json import as_json
from ..base.table import aligned
from . import published as paper


@dataclass(frozen=True)
class Column:
    """One column: its heading, and a function that writes a row of the report in it."""

    heading: str
    write: Callable[[dict[str, Any]], str]


def number(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits, thousands separated, no exponent in between."""
    if value != 0 and not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    text = f"{float(f'{value:.{digits - 1}e}'):,.10f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def per_frame(penetration: list[dict[str, Any]], part: str) -> str:
    """Depths in mm, frame after frame."""
    return " / ".join(number(1e3 * depth[part]) for depth in penetration)


CONTACT = (
    Column("frame", lambda r: str(r["frame"])),
    Column("t [s]", lambda r: f"{r['time']:.2f}"),
    Column("method", lambda r: str(r["method"])),
    Column("variant", lambda r: r["variant"]),
    Column("deepest point [mm]", lambda r: number(1e3 * r["penetration"]["points"])),
    Column("deepest triangle [mm]", lambda r: number(1e3 * r["penetration"]["triangles"])),
    Column("triangle, so far [mm]", lambda r: number(1e3 * r["deepest_so_far"]["triangles"])),
    Column("points touching", lambda r: str(r["points_touching"])),
    Column("energy gained [J]", lambda r: number(r["energy_gained"])),
    Column("kinetic energy [J]", lambda r: number(r["energy"]["kinetic"])),
)

STUDY = (
    Column("dt [s]", lambda r: number(r["dt"])),
    Column("method", lambda r: str(r["method"])),
    Column("deepest point [mm]", lambda r: per_frame(r["penetration"], "points")),
    Column("deepest triangle [mm]", lambda r: per_frame(r["penetration"], "triangles")),
    Column("energy gained [J]", lambda r: number(r["energy_gained"])),
)

_RATES = (
    Column("us/step", lambda r: number(r["microseconds_per_step"])),
    Column("steps/s", lambda r: number(r["steps_per_second"])),
    Column("lower quartile", lambda r: number(r["lower_quartile"])),
    Column("upper quartile", lambda r: number(r["upper_quartile"])),
    Column("frames/s", lambda r: number(r["frames_per_second"])),
)

METHODS = (Column("method", lambda r: str(r["method"])), Column("window", lambda r: str(r["window"])), *_RATES)

SPEEDUP = (
    Column("stepper", lambda r: r["kind"]),
    Column("precision", lambda r: r["precision"]),
    Column("threads", lambda r: str(r["threads"])),
    *_RATES,
    Column("times the reference", lambda r: number(r["speedup"])),
    Column("set-up [ms]", lambda r: number(1e3 * r["setup_seconds"])),
)

COMPARISON = (
    Column("sphere", lambda r: r["scene"]),
    Column("response", lambda r: r["response"]),
    Column("deepest point [mm]", lambda r: number(1e3 * r["points"])),
    Column("deepest triangle [mm]", lambda r: number(1e3 * r["triangles"])),
    Column("points passed through", lambda r: str(r["crossings"])),
    Column("energy gained [J]", lambda r: number(r["energy_gained"])),
    Column("us/step", lambda r: number(r["microseconds_per_step"]) if r["microseconds_per_step"] else "-"),
    Column("ended", lambda r: r["failure"] or ""),
)


@dataclass(frozen=True)
class Table:
    """Headings and rows as strings; an empty `caption` for an experiment's main table."""

    caption: str
    headings: list[str]
    rows: list[list[str]]


def tables(number: str, experiment: dict[str, Any]) -> list[Table]:
    """The tables of experiment `number`."""
    if number in ("1", "2"):
        made = [_table("", CONTACT, sorted(experiment["cells"], key=lambda cell: cell["frame"]))]
        if experiment.get("step_study"):
            caption = "The same frames with coarser steps, as printed"
            made.append(_table(caption, STUDY, experiment["step_study"]))
        return made
    if number == "5":
        return [_table("", COMPARISON, experiment["rows"])]
    if number == "4":
        return [_table("", SPEEDUP, experiment["rows"])]
    rows = []
    for row in experiment["rows"]:
        named = {"method": row["method"]}
        rows += [{**w, **named, "window": k} for k, w in enumerate(row["windows"], start=1)]
        rows.append({**row, "window": "all"})
    return [_table("", METHODS, rows)]


def _table(caption: str, columns: tuple[Column, ...], rows: list[dict[str, Any]]) -> Table:
    body = [[column.write(row) for column in columns] for row in rows]
    return Table(caption, [column.heading for column in columns], body)


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
