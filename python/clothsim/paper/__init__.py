"""The four experiments of Kim et al. as one call, with a report to read and one to compute with.

`docs/reproduction.md` explains the choices behind them; `clothsim reproduce` is the command.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.machine import provenance
from clothsim.scenes import PAPER_DT

from ..base import check
from ..base.extras import needed
from ..base.progress import ProgressBar
from . import paper_page as page
from . import paper_plots as plots
from . import paper_report, performance, pictures
from . import published as paper
from . import responses as contact
from .paper_page import write_gallery
from .paper_report import text, write
from .paper_settings import FULL, QUICK, Settings, reductions
from .side_by_side import RESPONSES, SCENES, comparison

__all__ = ["FULL", "QUICK", "Settings", "reproduce", "text", "write_gallery"]

SCHEMA = 1
EXPERIMENTS = (1, 2, 3, 4, 5)
LIVE = {"1": "live_static.html", "2": "live_moving.html"}
"""Pages of the gallery that simulate the scene of an experiment in the browser."""


def reproduce(
    out: str | os.PathLike[str] = "report",
    *,
    quick: bool = False,
    settings: Settings | None = None,
    experiments: Collection[int] = EXPERIMENTS,
    threads: int | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Run the paper's experiments and write the report folder.

    Parameters
    ----------
    out : path, default "report"
        Folder of the report; made if missing, files of an earlier report are replaced.
    quick : bool, default False
        Fewer and coarser steps, so that all four end within a minute on two cores.
    settings : Settings, optional
        Sizes of the experiments, in place of the choice by `quick`.
    experiments : collection of int, default (1, 2, 3, 4, 5)
        Numbers of experiments: 1 static sphere, 2 moving sphere, 3 frame rate, 4 speed against the
        scalar reference, 5 every collision response. Experiment 4 compares the SIMD core and, with
        a graphics adapter, the compute shader.
    threads : int, optional
        Threads to use, >= 1. Default: the choice of the core.
    progress : bool, default False
        Show a progress bar on stderr (needs tqdm).

    Returns
    -------
    dict
        The contents of report.json: "schema", "settings", "reductions", "provenance" and
        "experiments", a mapping from "1" to "5". "folder" holds report.txt, report.json,
        index.html, the pictures, and the pages of Tables 3 and 4. Its live.html leads to the paper's scenes, simulated
        in the browser.

    Raises
    ------
    ValueError
        For an unknown experiment, `threads` < 1 or an `out` that is no folder.
    ImportError
        Without matplotlib, naming the extra that brings it.
    """
    chosen = sorted(set(experiments))
    if not chosen or not set(chosen) <= set(EXPERIMENTS):
        raise ValueError(f"experiments must be some of {EXPERIMENTS}, got {tuple(experiments)!r}")
    if threads is None:
        threads = int(cs.build_config()["openmp_threads"])
    else:
        threads = check.integer("threads", threads, minimum=1)
    needed("matplotlib", "the reproduction", "plot")
    settings = settings or (QUICK if quick else FULL)
    folder = check.folder("out", out).resolve()
    folder.mkdir(parents=True, exist_ok=True)

    report: dict[str, Any] = {
        "schema": SCHEMA,
        "paper": paper.CITATION,
        "settings": {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(settings).items()},
        "reductions": reductions(settings),
        "provenance": provenance(),
        "experiments": {},
    }
    drawn = []
    for number in map(str, chosen):
        if number in ("1", "2"):
            case_set, entry = _contact(number, settings, threads, progress, folder)
            drawn.append(case_set)
        elif number == "5":
            entry = _comparison(settings, progress)
        else:
            entry = _performance(number, settings, threads, progress, folder)
        entry["notes"] = _notes(entry)
        report["experiments"][number] = entry
    overview = pictures.draw_overview(drawn, folder)
    if overview:
        report["overview"] = overview
    report["folder"] = str(folder)
    report["live"] = write_gallery(folder).name
    write(report, folder)
    page.write(report, folder)
    return report


def _contact(
    number: str, settings: Settings, threads: int, progress: bool, folder: Path
) -> tuple[tuple[contact.Experiment, list[contact.Case]], dict[str, Any]]:
    experiment = contact.experiment(number, settings)
    total = len(paper.METHODS) * len(paper.VARIANTS) * max(experiment.frames)
    with _bar(progress, number, total, "frame") as bar:
        cases = contact.run(experiment, settings, threads=threads, advance=bar.advance)
    pictures.draw_cells(experiment, cases, settings, folder)
    study = contact.step_study(experiment, settings, threads=threads) if number == "1" else []
    steps = settings.steps_per_frame(experiment.dt)
    scene = contact.scene_of(experiment, 2, "corrected")
    entry = {
        "title": experiment.title,
        "paper": paper.CLAIMS[number],
        "setting": f"RK4 in double precision, dt = {experiment.dt:g} s, a frame is {settings.frame_dt:g} s = {steps} steps.",
        "dt": experiment.dt,
        "frame_dt": settings.frame_dt,
        "frames": list(experiment.frames),
        "radius": scene.spheres[0].radius,
        "cells": [cell for case in cases for cell in case.cells],
        "histories": [{"method": c.method, "variant": c.variant, "failure": c.failure, **c.history} for c in cases],
        "step_study": study,
        "sheet": pictures.draw_sheet(experiment, cases, folder),
        "page": pictures.play(experiment, cases, folder),
        "live": LIVE[number],
        "plot": plots.history(experiment, cases, folder),
        "plot_caption": "Deepest triangle and energy gained, frame by frame.",
    }
    return (experiment, cases), entry


def _notes(entry: dict[str, Any]) -> list[str]:
    """Lines below the tables: runs that ended early, and agreement of the steppers."""
    notes = [
        f"Method {h['method']}, {h['variant']}, ended early: {h['failure']}."
        for h in entry.get("histories", ())
        if h["failure"]
    ]
    if "agreement" in entry:
        agreement = paper_report.number(entry["agreement"])
        notes.append(
            f"After {entry['agreement_steps']} steps, positions of core and reference differ by at most {agreement} m."
        )
    return notes


def _comparison(settings: Settings, progress: bool) -> dict[str, Any]:
    part = settings.comparison_part
    with _bar(progress, "5", len(SCENES) * len(RESPONSES), "row") as bar:
        rows = comparison(part=part, advance=bar.advance)
    scenes = "; ".join(f"{name}: dt = {dt:g} s, {part * duration:g} s" for name, (_, dt, duration) in SCENES.items())
    return {
        "title": "Every collision response on a static, a moving and a fast sphere",
        "paper": paper.CLAIMS["5"],
        "setting": f"{scenes}. The moving sphere is that of experiment 2; the fast one comes up at "
        "100 m/s under the level cloth. Double precision; every step is looked at for points that "
        "pass, every fourth for triangles. With a moving sphere the energy includes its work. "
        "Cost: least of many windows, in contact, one thread.",
        "rows": rows,
    }


def _performance(number: str, settings: Settings, threads: int, progress: bool, folder: Path) -> dict[str, Any]:
    frame = settings.steps_per_frame(PAPER_DT)
    dt = settings.timing_dt
    if number == "3":
        with _bar(progress, number, 2 * settings.runs, "run") as bar:
            result = performance.methods(settings, advance=bar.advance)
        entry = {
            "title": "Frame rate, method 1 against method 2",
            "setting": f"The falling cloth of experiment 1, dt = {dt:g} s, double precision, "
            f"one thread, mean of every {settings.window_frames} frames over "
            f"{settings.runs} runs, the two methods in turn. A frame is {settings.frame_dt:g} s: "
            f"{frame} steps of the paper's {PAPER_DT:g} s. Rates are medians over the runs, "
            "quartiles are in steps/s.",
            "runs": settings.runs,
            "window_frames": settings.window_frames,
            **result,
        }
        entry["plot"] = plots.methods(entry, folder)
        entry["plot_caption"] = (
            "As Figure 9: every window of frames, median and quartiles of runs. "
            f"The paper has {paper.FRAMES_PER_SECOND} frames/s, each of one step."
        )
    else:
        adapters, missing = performance.available_adapters()
        variants = 1 + 2 * len({1, threads}) + sum(1 + a.float64 for a in adapters)
        with _bar(progress, number, variants * settings.runs, "run") as bar:
            entry = performance.speedup(settings, threads=threads, adapters=adapters, advance=bar.advance)
        entry["gpu_missing"] = missing
        entry["title"] = "Method 2: SIMD core and compute shader against one scalar thread"
        entry["setting"] = (
            f"{settings.speedup_steps} steps of {dt:g} s a run, fewer where they take more than "
            f"{settings.speedup_seconds:g} s, from the same state in contact, "
            f"{settings.runs} runs, the steppers in turn. The scalar reference walks the springs "
            f"one by one, compiled with -O3. A frame is {frame} steps of {PAPER_DT:g} s. "
            + (
                f"The GPU side of Figure 10 is not run: {missing}."
                if missing
                else "The compute shader runs on every graphics adapter of this machine."
            )
        )
        entry["plot"] = plots.speedup(entry, folder)
        entry["plot_caption"] = f"{'The CPU side of ' if missing else ''}Figure 10: steps per second in each run."
    return {**entry, "dt": dt, "paper": paper.CLAIMS[number]}


def _bar(progress: bool, number: str, total: int, unit: str) -> ProgressBar:
    return ProgressBar(progress, total=total, unit=unit, desc=f"experiment {number}")
