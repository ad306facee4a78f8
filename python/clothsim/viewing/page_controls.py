"""Controls of the page and its sentences, as HTML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from ..run.result import Run
from .camera import DIRECTIONS
from .packing import TOP_PARTS

SHORTEST = 4.0  # s; a run that is over sooner is shown slowed down
SPEEDS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1, 2, 4)
VIEWS = ("corner", "front", "right", "top")
TURNED_BY = "On a focused cloth shift and arrows turn, plus and minus enlarge, 0 goes back."


def web_file(name: str) -> str:
    """The text of a file of web/."""
    return (files(__package__) / "web" / name).read_text(encoding="utf-8")


def filled(name: str, **values: str) -> str:
    """A file of web/ with its $names replaced."""
    return Template(web_file(name)).substitute(values)


def controls(meta: Mapping[str, Any], runs: Mapping[str, Run]) -> str:
    duration = max(float(run.t[-1] - run.t[0]) for run in runs.values())
    usual = max(s for s in SPEEDS if s <= max(min(1.0, duration / SHORTEST), SPEEDS[0]))
    speeds = "".join(
        f'<option value="{s}"{" selected" if s == usual else ""}>{s if s >= 1 else f"1/{round(1 / s)}"} x</option>'
        for s in SPEEDS
    )
    texts = {"depth": "depth below a sphere", "difference": f"difference to {next(iter(runs))}"}
    modes = "".join(
        f'<option value="{name}">{escape(texts.get(name, name))}</option>'
        for name in ("faces", "stretch", "speed", "depth", "difference")
        if name == "faces" or name in meta["tops"]
    )
    tops = "".join(f"<option{' selected' if name == '99 %' else ''}>{name}</option>" for name in TOP_PARTS)
    point = "".join(
        f'<input type="number" id="{name}" min="0" placeholder="{name}" aria-label="{name} of a mass point"> '
        for name in ("row", "column")
    )
    return filled("controls.html", speeds=speeds, modes=modes, tops=tops, point=point)


def few(runs: Mapping[str, Run]) -> str:
    """A sentence where a run has no frames between the first and the last."""
    short = [label for label, run in runs.items() if len(run) <= 2]
    if not short:
        return ""
    return (
        f'<p id="few">Only the marked times are stored of {escape(", ".join(short))}, so nothing between them is shown: '
        "give fps=30 to simulate for a film.</p>\n"
    )


def views() -> str:
    buttons = "".join(
        f'<button type="button" data-direction="{json.dumps(DIRECTIONS[name])}">{name}</button>' for name in VIEWS
    )
    return f'<span class="views">view {buttons}</span>'


def small_print(meta: Mapping[str, Any]) -> str:
    micron = 1e6 * max(run["precision"] for run in meta["runs"])
    words = (
        "Drag to turn, shift-drag or two fingers to move, wheel or pinch to enlarge, double-click to go back, click for the "
        f"values of a mass point. Space plays, arrows step. {TURNED_BY} Positions are stored to {micron:.2g} um. "
        "A colour scale ends at the highest value, or at that which 99 % or 90 % of all points and frames do not exceed. "
        "Blue: upper face at the start; sand: lower face; small balls: pins."
    )
    if "depth" in meta["tops"]:
        words += (
            " Red: surface of a sphere with cloth under it, stronger with depth up to 10 mm. A point in "
            "contact is nearer to a sphere than the contact radius and 1/32 of the spacing."
        )
    return words
