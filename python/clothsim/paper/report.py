"""The report: one list of blocks, written as text, as a page that fetches nothing, and as JSON."""

from __future__ import annotations

import textwrap
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

import numpy as np

import clothsim as cs
from clothsim.typing import Report

from ..base.files import write_bytes
from ..base.plots import BLUE, GREY, RED, figure, name_lines, save, style
from ..base.table import aligned
from .experiments import FRAMES, VARIANTS, Case
from .findings import CLAIMS, findings, here, number

Block = tuple[str, Any]  # kind and content

FRONT, BACK = (1.0, 0.6, 1.3), (-0.6, 0.9, 0.7)  # the paper draws frame 200 of the moving sphere from the back
STAGE = (-1.2, -1.6, -0.6), (1.6, 1.1, 1.6)  # m; mass points that a collision throws further are cut

Column = tuple[str, Callable[[dict[str, Any]], str]]


def _column(heading: str, key: str, factor: float = 1.0) -> Column:
    return heading, lambda row: row[key] if isinstance(row[key], str) else number(factor * row[key])


RATES = [
    _column("us a step", "microseconds_per_step"),
    _column("steps/s, median", "steps_per_second"),
    _column("lower quartile", "lower_quartile"),
    _column("upper quartile", "upper_quartile"),
    _column("frames/s", "frames_per_second"),
]
COLORS = (
    "Blue: the cloth's upper face as it starts; sand: its lower face. Red: the sphere's surface where cloth lies under it, "
    "stronger with depth. The pictures of a frame have one scale."
)
COLUMNS: dict[str, list[Column]] = {
    "cells": [
        _column("frame", "frame"),
        ("t [s]", lambda r: f"{r['time']:.2f}"),
        _column("method", "method"),
        _column("variant", "variant"),
        ("deepest point [mm]", lambda r: number(1e3 * r["penetration"]["points"])),
        ("deepest triangle [mm]", lambda r: number(1e3 * r["penetration"]["triangles"])),
        _column("triangle, so far [mm]", "deepest_so_far", 1e3),
        _column("mass points passed so far", "points_passed"),
        _column("mass points that touch", "points_touching"),
        _column("total energy gained [J]", "energy_gained"),
    ],
    "study": [
        _column("step [s]", "dt"),
        _column("method", "method"),
        ("deepest point at each frame [mm]", lambda r: " / ".join(number(1e3 * p["points"]) for p in r["penetration"])),
        ("deepest triangle [mm]", lambda r: " / ".join(number(1e3 * p["triangles"]) for p in r["penetration"])),
        _column("total energy gained [J]", "energy_gained"),
    ],
    "3": [_column("method", "method"), _column("window", "window"), *RATES],
    "4": [
        _column("stepper", "kind"),
        _column("precision", "precision"),
        _column("threads", "threads"),
        *RATES,
        _column("times the reference", "speedup"),
        _column("first step [ms]", "first_step_seconds", 1e3),
    ],
    "5": [
        _column("sphere", "scene"),
        _column("response", "response"),
        _column("deepest point [mm]", "points", 1e3),
        _column("deepest triangle [mm]", "triangles", 1e3),
        _column("mass points passed", "crossings"),
        _column("total energy gained [J]", "energy_gained"),
    ],
}


def _table(columns: Sequence[Column], rows: Iterable[dict[str, Any]], caption: str = "") -> Block:
    return "table", (caption, [heading for heading, _ in columns], [[write(row) for _, write in columns] for row in rows])


def blocks(report: dict[str, Any]) -> list[Block]:
    """The report in its order: what held, the experiments, what was cut."""
    origin, experiments = report["provenance"], report["experiments"]
    build, machine = origin["build"], origin["machine"]
    intro = (
        "Kim et al., Real-time collision response between cloth and sphere object in Unity: what the paper claims, beside "
        "what the same scenes give here."
    )
    elsewhere = {"live.html": "the scenes, live in the browser", "report.txt": "as text", "report.json": "all numbers"}
    made: list[Block] = [
        ("h1", "The experiments of Kim et al., run by clothsim"),
        ("p", intro),
        ("h2", "Did it hold?"),
        ("findings", findings(experiments)),
        ("list", [f"{name}: {meaning}" for name, meaning in VARIANTS.items()]),
        ("links", elsewhere),
    ]
    for key, entry in experiments.items():
        made += [("h2", f"Experiment {key}: {entry['title']}"), ("p", entry["setting"]), ("claim", CLAIMS[key])]
        made.append(("here", here(key, entry)))
        made += [("p", f"{name} ended early: {failure}.") for name, failure in entry.get("failures", {}).items()]
        if "cells" in entry:
            cells = sorted(entry["cells"], key=lambda cell: cell["frame"])
            made.append(("p", COLORS))
            times = {frame: frame * report["settings"]["frame_dt"] for frame in FRAMES[key]}
            for frame, t in times.items():
                shown = [(cell["picture"], _caption(cell)) for cell in cells if cell["frame"] == frame]
                made.append(("pictures", (f"Frame {frame}, t = {t:.2f} s", shown)))
            play = {f"{entry['page']}#t={t:g}": f"play from frame {frame}" for frame, t in times.items()}
            made.append(("links", {**play, entry["live"]: "simulate this scene in the browser"}))
            made.append(_table(COLUMNS["cells"], cells))
            if entry["study"]:
                made.append(_table(COLUMNS["study"], entry["study"], "The same frames with coarser steps, as printed"))
        else:
            made.append(_table(COLUMNS[key], entry["rows"]))
        if "plot" in entry:
            made.append(("pictures", ("", [(entry["plot"], entry["plot_caption"])])))
    if report["cuts"]:
        made += [("h2", "What this short form cuts"), ("list", report["cuts"])]
    computer = f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}"
    program = f"clothsim {build['version']}, {build['instruction_set']}, {build['compiler']}"
    made.append(("p", f"{program}; {computer}; {origin['created']}"))
    return made


def _caption(cell: dict[str, Any]) -> str:
    depth = number(1e3 * cell["penetration"]["triangles"])
    return f"Method {cell['method']}, {cell['variant']}: {depth} mm deep, {cell['points_passed']} points passed"


def as_text(report: dict[str, Any]) -> str:
    lines: list[str] = []
    for kind, content in blocks(report):
        if kind in ("h1", "h2"):
            lines += [content, "-" * len(content)]
        elif kind == "findings":
            for f in content:
                told = f"{f.claim}: {f.held.upper()}. As printed: {f.printed}. Corrected: {f.corrected}."
                lines += textwrap.wrap(told, 100, initial_indent="- ", subsequent_indent="  ")
        elif kind == "table":
            caption, head, rows = content
            lines += [*([caption] if caption else []), aligned(head, rows, (), rule=True, stacked=True)]
        elif kind == "list":
            for entry in content:
                lines += textwrap.wrap(entry, 100, initial_indent="- ", subsequent_indent="  ")
        elif kind in ("p", "claim", "here"):
            lines += textwrap.wrap({"claim": "The paper: ", "here": "Here: "}.get(kind, "") + content, 100)
        else:
            continue
        lines.append("")
    return "\n".join(lines)


def write_page(path: Path, title: str, made: Iterable[Block]) -> Path:
    """Write blocks as a page that holds its pictures."""
    parts = [_html(kind, content, path.parent) for kind, content in made]
    css = (files(__package__) / "report.css").read_text(encoding="utf-8")
    head = '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">'
    body = "\n".join(parts)
    page = f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n<title>{title}</title>\n<style>\n{css}</style>\n</head>\n'
    page += f"<body>\n{body}\n</body>\n</html>\n"
    return write_bytes(path, page.encode())


def _html(kind: str, content: Any, folder: Path) -> str:
    if kind in ("h1", "h2", "p"):
        return f"<{kind}>{escape(content)}</{kind}>"
    if kind in ("claim", "here"):
        return f'<div class="{kind}"><strong>{"The paper" if kind == "claim" else "Here"}:</strong> {escape(content)}</div>'
    if kind == "list":
        return "<ul>" + "".join(f"<li>{escape(entry)}</li>" for entry in content) + "</ul>"
    if kind == "links":
        return "<p>" + " · ".join(f'<a href="{to}">{escape(name)}</a>' for to, name in content.items()) + "</p>"
    if kind == "pictures":
        heading, shown = content
        figures = "".join(f"<figure>{_image(folder / name, caption)}</figure>" for name, caption in shown)
        above = f"<h3>{escape(heading)}</h3>" if heading else ""
        return f'{above}<div class="{"cells" if heading else "plot"}">{figures}</div>'
    if kind == "findings":
        head = ["claim of the paper", "held?", "our number, as printed", "our number, corrected"]
        content = "", head, [[f.claim, f.held, f.printed, f.corrected] for f in content]
    caption, head, rows = content
    top = "".join(f"<th>{escape(heading)}</th>" for heading in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    table = f'<table class="{kind}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'
    return f'{f"<h3>{escape(caption)}</h3>" if caption else ""}<div class="scroll">{table}</div>'


def _image(path: Path, caption: str) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    alt, below = escape(caption, quote=True), escape(caption)
    return f'<img src="data:image/png;base64,{data}" alt="{alt}"><figcaption>{below}</figcaption>'


def draw_cells(number: str, cases: Sequence[Case], width: int, folder: Path) -> None:
    """Write the picture of each cell, with one camera for all of a frame, and enter its path in the cell."""
    (folder / f"experiment{number}").mkdir(parents=True, exist_ok=True)
    for frame in FRAMES[number]:
        reached = [case for case in cases if frame in case.states]
        direction = BACK if (number, frame) == ("2", 200) else FRONT
        if not reached:
            continue
        states = [case.states[frame] for case in reached]
        seen = [np.clip(x, *STAGE).reshape(-1, 3) for x, _ in states]
        axes = cs.Camera(direction, (0, 0, 0), 1, 1).axes()
        ends = np.concatenate([axes, -axes])
        seen += [s.center_at(t) + s.radius * ends for _, t in states for s in reached[0].scene.spheres]
        camera = cs.Camera.around(direction, np.concatenate(seen))
        for case in reached:
            x, t = case.states[frame]
            cell = next(c for c in case.cells if c["frame"] == frame)
            cell["picture"] = f"experiment{number}/frame{frame}_{case.name.replace(', ', '_').replace(' ', '_')}.png"
            cs.picture(case.scene, x, t, camera=camera, width=width, ground=False).save(folder / cell["picture"])


def play(number: str, cases: Sequence[Case], folder: Path) -> str:
    """Write a page that plays all cases of an experiment in step."""
    runs = {}
    for case in cases:
        t, x, v = map(np.array, zip(*case.played))
        runs[case.name] = cs.Run(case.scene, t, x, v, cast(Report, {}))
    cs.compare(runs).to_html(folder / f"experiment{number}.html", title=f"Experiment {number}, all cases in step")
    return f"experiment{number}.html"


def plot_history(number: str, cases: Sequence[Case], folder: Path) -> str:
    """Deepest triangle and energy gained, frame by frame."""
    drawn, ((depth,), (energy,)) = figure(8, 5.2, 2, sharex=True)
    for case in cases:
        frames, triangles, gained = np.array(case.history).T
        line = {"color": {1: RED, 2: BLUE}[case.method], "ls": "--" if case.variant == "as printed" else "-"}
        depth.plot(frames, np.maximum(1e3 * triangles, 1e-3), **line, label=case.name)
        energy.plot(frames, gained, **line)
    for panel in (depth, energy):
        for frame in FRAMES[number]:
            panel.axvline(frame, color=GREY, lw=0.8, zorder=0)
    depth.set(yscale="log", ylim=(1e-3, None), ylabel="deepest triangle [mm]")
    depth.legend(ncols=4, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0))
    energy.set(ylabel="energy gained [J]", xlabel="frame (grey: those of the paper's table)")
    energy.set_yscale("symlog", linthresh=100.0)
    save(drawn, folder / f"experiment{number}_history.png")
    return f"experiment{number}_history.png"


def plot_rates(entry: dict[str, Any], folder: Path) -> str:
    """As Figure 9: frames/s of each window, median and quartiles of runs."""
    drawn, ((panel,),) = figure(8, 3.8)
    for method, color in ((1, RED), (2, BLUE)):
        rows = [r for r in entry["rows"] if r["method"] == method and r["window"] != "all"]
        names = ("frames_per_second", "lower_quartile", "upper_quartile")
        middle, low, high = (np.array([r[name] for r in rows]) for name in names)
        low, high = low / entry["frame_steps"], high / entry["frame_steps"]
        places = np.arange(1, len(rows) + 1) + 0.04 * (method - 1.5)
        panel.errorbar(
            places, middle, [middle - low, high - middle], fmt="o-", color=color, capsize=4, label=f"method {method}"
        )
    panel.set(xlabel="window of frames", ylabel=f"frames/s of {entry['frame_steps']} steps", xticks=range(1, len(rows) + 1))
    panel.legend(ncols=2, fontsize="small", frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    save(drawn, folder / "figure9.png")
    return "figure9.png"


def plot_speedup(entry: dict[str, Any], folder: Path) -> str:
    """As Figure 10: steps/s of each run."""
    drawn, ((panel,),) = figure(8, 3.8)
    for k, row in enumerate(entry["rows"]):
        threads = f"{row['threads']} thread{'s' * (row['threads'] > 1)}"
        runs = range(1, len(row["runs"]) + 1)
        panel.plot(
            runs, row["runs"], **style(k), label=f"{row['kind']}, {row['precision']}, {threads} ({row['speedup']:.1f}x)"
        )
    panel.set(xlabel="run", ylabel="steps/s", yscale="log", xticks=runs)
    name_lines(panel)
    save(drawn, folder / "figure10.png")
    return "figure10.png"
