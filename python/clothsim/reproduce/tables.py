"""The report's numbers as tables of strings: one form for the text and the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One column: its heading, and how a row of the report is written in it."""

    heading: str
    write: Callable[[dict], str]


def number(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits, thousands separated, no exponent in between."""
    if value != 0 and not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    text = f"{float(f'{value:.{digits - 1}e}'):,.10f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


CONTACT = (
    Column("frame", lambda r: str(r["frame"])),
    Column("t [s]", lambda r: f"{r['time']:.2f}"),
    Column("method", lambda r: str(r["method"])),
    Column("variant", lambda r: r["variant"]),
    Column("deepest point [mm]", lambda r: number(1e3 * r["penetration"]["points"])),
    Column("deepest triangle [mm]", lambda r: number(1e3 * r["penetration"]["triangles"])),
    Column("triangle, so far [mm]", lambda r: number(1e3 * r["deepest_so_far"]["triangles"])),
    Column("points touching", lambda r: str(r["points_touching"])),
    Column("contact energy [J]", lambda r: number(r["contact_energy"])),
    Column("kinetic energy [J]", lambda r: number(r["energy"]["kinetic"])),
)

METHODS = (
    Column("method", lambda r: str(r["method"])),
    Column("window", lambda r: str(r["window"])),
    Column("us/step", lambda r: number(r["microseconds_per_step"])),
    Column("steps/s", lambda r: number(r["steps_per_second"])),
    Column("slowest run", lambda r: number(r["slowest"])),
    Column("fastest run", lambda r: number(r["fastest"])),
    Column("frames/s", lambda r: number(r["frames_per_second"])),
)

SPEEDUP = (
    Column("stepper", lambda r: r["kind"]),
    Column("precision", lambda r: r["precision"]),
    Column("threads", lambda r: str(r["threads"])),
    Column("us/step", lambda r: number(r["microseconds_per_step"])),
    Column("steps/s", lambda r: number(r["steps_per_second"])),
    Column("slowest run", lambda r: number(r["slowest"])),
    Column("fastest run", lambda r: number(r["fastest"])),
    Column("frames/s", lambda r: number(r["frames_per_second"])),
    Column("times the reference", lambda r: number(r["speedup"])),
    Column("set-up [ms]", lambda r: number(1e3 * r["setup_seconds"])),
)


def table(number: str, experiment: dict) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of experiment `number`."""
    if number in ("1", "2"):
        columns, rows = CONTACT, sorted(experiment["cells"], key=lambda cell: cell["frame"])
    elif number == "3":
        columns, rows = METHODS, []
        for row in experiment["rows"]:
            rows += [
                {"method": row["method"], "window": str(k + 1), **window}
                for k, window in enumerate(row["windows"])
            ]
            rows.append({**row, "window": "all"})
    else:
        columns, rows = SPEEDUP, experiment["rows"]
    return [c.heading for c in columns], [[c.write(row) for c in columns] for row in rows]
