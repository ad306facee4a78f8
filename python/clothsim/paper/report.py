"""The report: one list of blocks, written as text and as a page that fetches nothing; its pictures
and players.
"""

from __future__ import annotations

import re
import textwrap
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

import clothsim as cs

from ..base.files import write_bytes
from .experiments import EXPERIMENTS, FRAMES, FULL, QUANTITIES, SIZES, Case, Settings
from .findings import format_number, judge_claims, summarize_experiment

FRONT = (1.0, 0.6, 1.3)
BACK = (-0.6, 0.9, 0.7)  # The paper draws frame 200 of the moving sphere from the back.
WIDTH = 440  # pixels of a picture
# The view has at most this box [m]: mass points that a collision throws further are cut.
STAGE = ((-1.2, -1.6, -0.6), (1.6, 1.1, 1.6))
COLORS = (
    "Blue: the cloth's upper face as it starts; sand: its lower face. Red: the sphere's surface "
    "where cloth lies under it, stronger with depth. The pictures of a frame have one scale."
)


METHODS = (
    "Method 1 reflects the velocity of a mass point that is found inside the sphere. Method 2 also "
    "moves the point back along its velocity, to the surface. As printed, the sphere's own "
    "velocity is ignored, and every point found inside is reflected. Corrected, velocities are "
    "relative to the sphere, and only approaching points are reflected. docs/reproduction.md tells "
    "more of the two, and of the choices where the paper is silent."
)


def _split_into_cells(table: str) -> list[list[str]]:
    """Split a table in Markdown into cells of its rows; the first row is the head."""
    rows = []
    for line in table.splitlines():
        if line.startswith("| ") and not line.startswith("| -"):
            rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def _markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    columns = [[head, "", *cells] for head, *cells in zip(head, *rows)]
    for cells in columns:
        width = max(map(len, cells))
        side = "<" if cells[2][:1].isalpha() else ">"
        cells[:] = [f"{cell:{side}{width}}" if cell else "-" * width for cell in cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in zip(*columns))


SEEN = ("points_passed", "points_touching", "energy_gained")
COLUMNS: dict[str, tuple[str, ...]] = {
    "cells": ("frame", "time", "case", "points", "triangles", "triangles_so_far", *SEEN),
    "study": ("dt", "case", "points", "triangles", "energy_gained"),
    "3": ("case", "steps_per_second", "frames_per_second", "each"),
    "4": ("case", "steps_per_second", "times_the_first", "each"),
    "5": ("sphere", "case", "points_so_far", "triangles_so_far", "points_passed", "energy_gained"),
}


def _table_of_rows(kind: str, rows: Iterable[dict[str, Any]]) -> str:
    """Return a table of the experiments' rows, in the units of `QUANTITIES`."""
    keys = COLUMNS[kind]
    heads = [QUANTITIES[key].heading for key in keys]
    return _markdown_table(
        heads, [[_format_quantity(key, row[key]) for key in keys] for row in rows]
    )


def _format_quantity(key: str, value: Any) -> str:
    factor = QUANTITIES[key].factor
    return format_number(value if factor == 1 else (factor * np.array(value)).tolist())


def _table_of_definitions() -> str:
    """Return the table of what the columns mean."""
    rows = [(entry.heading, key, entry.definition) for key, entry in QUANTITIES.items()]
    return _markdown_table(("quantity", "in `report.json`", "definition"), rows)


def list_reductions(settings: Settings) -> list[str]:
    """List the differences from the full reproduction."""
    own = asdict(settings)
    full = asdict(FULL)
    rows = [
        (title, *(format_number(np.ravel(sizes[key]).tolist()) for sizes in (own, full)))
        for key, title in SIZES.items()
    ]
    return [
        f"{title}: {value} instead of {usual}" for title, value, usual in rows if value != usual
    ]


def report_as_markdown(report: dict[str, Any]) -> list[str]:
    """Write the report in Markdown: what held, the experiments, how they were run, what was cut."""
    experiments = report["experiments"]
    build = report["provenance"]["build"]
    machine = report["provenance"]["machine"]
    rows = [finding[:5] for judged in judge_claims(experiments).values() for finding in judged]
    head = [
        "claim of the paper",
        "it holds if",
        "held?",
        "our number, as printed",
        "our number, corrected",
    ]
    blocks = [
        "# The experiments of Kim et al., run by clothsim",
        "The claims of Real-time collision response between cloth and sphere object in "
        "Unity, and what we measured.",
        *(["## Did it hold?", _markdown_table(head, rows)] if rows else []),
        "[the scenes, live in the browser](live.html) · [as text](report.txt) · [all "
        "numbers](report.json)",
    ]
    blocks += ["## The two methods, in two variants", METHODS]
    for key, entry in experiments.items():
        experiment = EXPERIMENTS[key]
        blocks += [
            f"## Experiment {key}: {experiment.title}",
            experiment.setting,
            f"> **The paper:** {experiment.claim}",
            f"> **Here:** {summarize_experiment(key, entry)}",
        ]
        blocks += [
            f"{name} ended early: {failure}." for name, failure in entry.get("failures", {}).items()
        ]
        blocks += (
            _contact_as_markdown(key, entry, report["settings"]["frame_dt"])
            if "cells" in entry
            else [_table_of_rows(key, entry["rows"])]
        )
    blocks += ["## Quantities", _table_of_definitions()]
    if report["cuts"]:
        blocks += [
            "## What this short form cuts",
            "\n".join(f"- {line}" for line in report["cuts"]),
        ]
    computer = f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}"
    program = f"clothsim {build['version']}, {build['instruction_set']}, {build['compiler']}"
    return [*blocks, f"{program}; {computer}; {report['provenance']['created']}"]


def _contact_as_markdown(key: str, entry: dict[str, Any], frame_dt: float) -> list[str]:
    blocks = [COLORS]
    times = {frame: f"{frame * frame_dt:g}" for frame in FRAMES[key]}
    for frame, t in times.items():
        cells = [cell for cell in entry["cells"] if cell["frame"] == frame]
        blocks += cells and [
            f"### Frame {frame}, t = {t} s",
            "\n".join(f"![{_caption_of_cell(cell)}]({cell['picture']})" for cell in cells),
        ]
    links = [f"[play from frame {frame}](experiment{key}.html#t={t})" for frame, t in times.items()]
    live = "live_static.html" if key == "1" else "live_moving.html"
    blocks.append(" · ".join([*links, f"[simulate this scene in the browser]({live})"]))
    blocks.append(_table_of_rows("cells", sorted(entry["cells"], key=lambda cell: cell["frame"])))
    return blocks + (
        ["### The same frames with coarser steps", _table_of_rows("study", entry["study"])]
        if entry["study"]
        else []
    )


def _caption_of_cell(cell: dict[str, Any]) -> str:
    return (
        f"{cell['case'].capitalize()}: {format_number(1e3 * cell['triangles'])} mm deep, "
        f"{cell['points_passed']} points passed"
    )


def _wrap_line(line: str) -> str:
    return textwrap.fill(line, 100, subsequent_indent="  " if line[0] == "-" else "")


def report_as_text(report: dict[str, Any]) -> str:
    """Write the report as plain text; a table of sentences is a list."""
    texts = []
    for part in report_as_markdown(report):
        if part.startswith("!["):
            continue
        if part.startswith("|") and len(part.splitlines()[0]) > 160:
            head, *rows = _split_into_cells(part)
            items = ["; ".join(f"{a}: {b}" for a, b in zip(head, row)) for row in rows]
            part = "\n".join(f"- {item}" for item in items)
        if not part.startswith("|"):
            part = "\n".join(map(_wrap_line, part.splitlines()))
        texts.append(part)
    return "\n\n".join(texts) + "\n"


def write_page(path: Path, title: str, blocks: Iterable[str]) -> Path:
    """Write parts in Markdown as a page that holds its pictures."""
    page = (files(__package__) / "report.html").read_text(encoding="utf-8")
    body = "\n".join(_part_as_html(part, path.parent) for part in blocks)
    return write_bytes(path, page.replace("TITLE", title).replace("BODY", body).encode())


def _inline_html(text: str) -> str:
    text = re.sub(r"`(.*?)`", r"<code>\1</code>", escape(text))
    text = re.sub(r"\*\*(.*?)\*\*", r"<strong>\1</strong>", text)
    return re.sub(r"\[([^]]*)\]\(([^)]*)\)", r'<a href="\2">\1</a>', text)


def _part_as_html(part: str, folder: Path) -> str:
    kind, _, text = part.partition(" ")
    if kind.startswith("#"):
        return f"<h{len(kind)}>{_inline_html(text)}</h{len(kind)}>"
    if kind == ">":
        style = "claim" if text.startswith("**The paper") else "here"
        return f'<div class="{style}">{_inline_html(text)}</div>'
    if kind == "-":
        items = "".join(f"<li>{_inline_html(line[2:])}</li>" for line in part.splitlines())
        return f"<ul>{items}</ul>"
    if kind == "|":
        return _table_as_html(part)
    if part.startswith("!["):
        images = re.findall(r"!\[(.*)\]\((.*)\)", part)
        figures = "".join(
            f"<figure>{_picture_as_html(folder / name, caption)}</figure>"
            for caption, name in images
        )
        return f'<div class="{"cells" if len(images) > 1 else "plot"}">{figures}</div>'
    return f"<p>{_inline_html(part)}</p>"


def _table_as_html(table: str) -> str:
    head, *rows = _split_into_cells(table)
    has_sentences = max(len(cell) for row in rows for cell in row) > 60
    marks = [' class="word"' if has_sentences or cell[:1].isalpha() else "" for cell in rows[0]]

    def row_as_html(tag: str, cells: Sequence[str]) -> str:
        texts = [f"<{tag}{mark}>{_inline_html(cell)}</{tag}>" for mark, cell in zip(marks, cells)]
        return f"<tr>{''.join(texts)}</tr>"

    body = "".join(row_as_html("td", row) for row in rows)
    style = " class=words" if has_sentences else ""
    content = f"<thead>{row_as_html('th', head)}</thead><tbody>{body}</tbody>"
    return f'<div class="scroll"><table{style}>{content}</table></div>'


def _picture_as_html(path: Path, caption: str) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<img src="data:image/png;base64,{data}" '
        f'alt="{escape(caption)}"><figcaption>{escape(caption)}</figcaption>'
    )


def write_cell_pictures(number: str, cases: Sequence[Case], folder: Path) -> None:
    """Write the picture of each cell, with one camera a frame, and enter its path in the cell."""
    (folder / f"experiment{number}").mkdir(parents=True, exist_ok=True)
    for frame in FRAMES[number]:
        direction = BACK if (number, frame) == ("2", 200) else FRONT
        axes = cs.Camera(direction, (0, 0, 0), 1, 1).axes()
        views = []
        points = []  # that the pictures of the frame have to show
        for case in cases:
            for cell in case.cells:
                if cell["frame"] != frame:
                    continue
                t, x = next(state[:2] for state in case.played if state[0] == cell["time"])
                views.append((case, cell, t, x))
                points.append(np.clip(x, *STAGE).reshape(-1, 3))
                for sphere in case.scene.spheres:
                    ends = sphere.radius * np.concatenate([axes, -axes])
                    points.append(sphere.center_at(t) + ends)
        for case, cell, t, x in views:
            name = case.name.replace(", ", "_").replace(" ", "_")
            cell["picture"] = f"experiment{number}/frame{frame}_{name}.png"
            camera = cs.Camera.around(direction, np.concatenate(points))
            picture = cs.picture(case.scene, x, t, camera=camera, width=WIDTH, ground=False)
            picture.save(folder / cell["picture"])


def write_player_page(number: str, cases: Sequence[Case], folder: Path) -> None:
    """Write a page that plays all cases of an experiment in step."""
    runs = {}
    for case in cases:
        t, x, v = map(np.array, zip(*case.played))
        runs[case.name] = cs.Run(case.scene, t, x, v, {})
    path = folder / f"experiment{number}.html"
    cs.compare(runs).to_html(path, title=f"Experiment {number}, all cases in step")
