"""The experiments of Kim et al. as one call, with a report; `docs/reproduction.md` explains the
choices behind them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import clothsim as cs

from ..base import check
from ..base.build import provenance
from ..base.files import as_json, write_bytes
from ..base.progress import ProgressBar
from . import experiments as lab
from . import report as pages
from .experiments import EXPERIMENTS, FULL, QUICK, Settings
from .findings import list_verdicts
from .report import report_as_text

__all__ = [
    "FULL",
    "QUICK",
    "Settings",
    "list_verdicts",
    "report_as_text",
    "reproduce",
    "write_gallery",
]

NUMBERS = tuple(map(int, EXPERIMENTS))


def reproduce(
    out: str | os.PathLike[str] = "report",
    *,
    quick: bool = False,
    settings: Settings | None = None,
    experiments: Collection[int] = NUMBERS,
    threads: int | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Run the paper's experiments and write the report folder.

    Parameters
    ----------
    out : path, default "report"
        Folder of the report; made if missing, files of an earlier report are replaced.
    quick, settings : bool and Settings, optional
        The short form, or own sizes; the report ends with what they cut.
    experiments : collection of int, default (1, 2, 3, 4, 5)
        Their numbers; 5 is ours.
    threads, progress : int and bool, optional
        Threads to use, by default those of the core; whether to show a progress bar on stderr
        (needs tqdm).

    Returns
    -------
    dict
        The contents of report.json: "settings", "cuts", "provenance", "experiments" (a mapping from
        "1") and "folder".
    """
    numbers = sorted(set(experiments))
    if not numbers or not set(numbers) <= set(NUMBERS):
        raise ValueError(f"experiments must be some of {NUMBERS}, got {tuple(experiments)!r}")
    if threads is None:
        threads = int(cs.build_config()["threads"])
    threads = check.integer("threads", threads, minimum=1)
    if settings is None:
        settings = QUICK if quick else FULL
    folder = check.path("out", out, "the path of a folder").resolve()
    folder.mkdir(parents=True, exist_ok=True)
    entries: dict[str, Any] = {}
    report = {
        "settings": asdict(settings),
        "cuts": pages.list_reductions(settings),
        "provenance": provenance(),
        "experiments": entries,
    }
    for number in numbers:
        total = lab.simulated_seconds(str(number), settings)
        with ProgressBar.for_simulated_time(progress, total, f"experiment {number}") as bar:
            entries[str(number)] = _run_experiment(
                str(number), settings, threads, folder, bar.advance
            )
    report["folder"] = str(folder)
    write_gallery(folder)
    write_bytes(folder / "report.txt", report_as_text(report).encode())
    write_bytes(folder / "report.json", (as_json(report) + "\n").encode())
    pages.write_page(
        folder / "index.html",
        "clothsim: the experiments of Kim et al.",
        pages.report_as_markdown(report),
    )
    return report


def _run_experiment(
    key: str, settings: Settings, threads: int, folder: Path, advance: Callable[[float], object]
) -> dict[str, Any]:
    if key == "3":
        return lab.measure_frame_rates(settings, advance)
    if key == "4":
        return lab.measure_speedup(settings, threads, advance)
    if key == "5":
        rows = lab.run_comparison(part=settings.part, threads=threads, advance=advance)
        failures = {
            f"{row['sphere']}, {row['case']}": row["failure"] for row in rows if row["failure"]
        }
        return {"rows": rows, "failures": failures}
    dt = settings.dt[int(key) - 1]
    cases = lab.run_contact(key, settings, dt, threads=threads, advance=advance)
    pages.write_cell_pictures(key, cases, folder)
    pages.write_player_page(key, cases, folder)
    return {
        "cells": [cell for case in cases for cell in case.cells],
        "failures": {case.name: case.failure for case in cases if case.failure},
        "study": lab.run_step_study(settings, threads, advance) if key == "1" else [],
    }


COTTON = cs.Cloth(
    (24, 24),
    mass=0.15,
    stiffness={"structural": 156.0, "shear": 105.0},
    damping=0.03,
    springs=("structural", "shear"),
    pins=(),
)
BALL = cs.Sphere((0.5, -0.3, 0.5), 0.25, friction=0.3)
FLOOR = cs.Plane((0.0, -0.6, 0.0), friction=0.3)
# File -> title, scene, and the moment of its picture [s], in which cloth lies on the sphere.
LIVE_PAGES: dict[str, tuple[str, cs.Scene, float]] = {
    "live_static.html": ("Experiment 1: a static sphere", cs.scenes.paper_static(), 0.3),
    "live_moving.html": ("Experiment 2: a moving sphere", cs.scenes.paper_moving(), 0.9),
    "live_swing.html": ("The cloth alone", cs.scenes.paper_swing(), 0.4),
    "live_penalty.html": (
        "Beyond the paper: contact as a force",
        cs.scenes.paper_moving("penalty", offset="cell"),
        0.9,
    ),
    "live_floor.html": (
        "Beyond the paper: a cotton sheet, a ball and a floor",
        cs.Scene(COTTON, [BALL, FLOOR]),
        0.4,
    ),
}


def write_gallery(folder: str | Path) -> Path:
    """Write live.html, which leads to a live page of each of the paper's scenes, and these pages
    beside it.
    """
    folder = Path(folder)
    title = "The scenes of Kim et al., live"
    parts = [
        f"# {title}",
        "Each page simulates one scene in your browser, by the compute shader, and makes no "
        "request. Drag the sphere and the pinned points, and choose the method in the list. A "
        "browser without WebGPU plays a stored run.",
    ]
    for name, (title, scene, moment) in LIVE_PAGES.items():
        scene.to_live_html(folder / name, title=title)
        picture = folder / name.replace(".html", ".png")
        cs.simulate(scene, moment).picture(width=400, path=picture)
        parts += [
            f"## {title}",
            f"![The scene at t = {moment:g} s]({picture.name})",
            f"[Open the page]({name})",
        ]
    return pages.write_page(folder / "live.html", f"clothsim: {title}", parts)
