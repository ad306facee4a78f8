"""The bench's files: tables as CSV, everything as JSON, plots."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from clothsim.base.extras import how_to_install
from clothsim.base.plain_json import as_json

from . import bench_plots as plots
from .bench_settings import FULL, NORMAL, QUICK, SECTIONS, Settings
from .figures import attempt
from .machine import slug


def name(report: dict[str, Any]) -> str:
    """How the files of this run begin: the machine, and what the run lacks of a whole one.

    A whole run has all sections and the settings `NORMAL` or `FULL`. Another has "-quick" or, with
    settings of one's own, "-custom" after the machine, and its sections if it has not all.
    """
    settings = Settings(**report["settings"])
    lacks = [] if settings in (NORMAL, FULL) else ["quick" if settings == QUICK else "custom"]
    if set(report["sections"]) != set(SECTIONS):
        lacks += report["sections"]
    return "-".join([slug(report["machine"]), *lacks])


def write(report: dict[str, Any], folder: Path) -> None:
    """Write `report` into `folder` as CSV, JSON and, where matplotlib is there, plots.

    The paths go to report["files"], and to report["skipped"] why a plot is missing. Plots come
    last: one that fails loses nothing that was measured.
    """
    folder.mkdir(parents=True, exist_ok=True)
    start, files = str(folder / name(report)), report["files"]
    if report["figures"]:
        files.append(f"{start}.csv")
        _table(files[-1], [{**figure, **_origin(report)} for figure in report["figures"]])
    if any(target["value"] is not None for target in report["targets"]):
        files.append(f"{start}-targets.csv")
        _table(files[-1], report["targets"])
    files.append(f"{start}.json")
    everything = Path(files[-1])
    _write_all(everything, report)
    _draw(report, start)
    _write_all(everything, report)


def _draw(report: dict[str, Any], start: str) -> None:
    if find_spec("matplotlib") is None:
        reason = f"matplotlib is not installed: {how_to_install('bench')}"
        report["skipped"].append({"plot": "all", "reason": reason})
        return

    def save(what: str) -> None:
        figure = plots.ALL[what](report)
        if figure is not None:
            figure.savefig(f"{start}-{what}.png", dpi=120)
            report["files"].append(f"{start}-{what}.png")

    for what in plots.ALL:
        attempt(partial(save, what), None, report["skipped"], plot=what)


def _origin(report: dict[str, Any]) -> dict[str, Any]:
    about = report["machine"]
    return {
        **{key: about[key] for key in ("cpu", "family", "model", "stepping")},
        "load": (about["load_average"] or [None])[0],
        "created": about["created"],
        "version": about["build"]["version"],
    }


def _table(path: str, rows: Sequence[dict[str, Any]]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def _write_all(path: Path, report: dict[str, Any]) -> None:
    """As JSON; the files by their names, as they lie side by side wherever they are moved."""
    names = [Path(file).name for file in report["files"]]
    path.write_text(as_json({**report, "files": names}) + "\n", encoding="utf-8")
