"""The experiments of Kim et al. as one call, with a report; `docs/reproduction.md` explains the choices behind them."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.machine import provenance
from clothsim.scenes import PAPER_DT

from ..base import check
from ..base.extras import needed
from ..base.files import write_bytes
from ..base.plain_json import as_json
from ..base.progress import ProgressBar
from . import report as pages
from .experiments import FRAMES, FULL, METHODS, QUICK, VARIANTS, Settings, contact, frame_rates, speedup, study
from .report import as_text as text
from .side_by_side import RESPONSES, SCENES, comparison

__all__ = ["FULL", "QUICK", "Settings", "reproduce", "text", "write_gallery"]

EXPERIMENTS = (1, 2, 3, 4, 5)


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
        Fewer and coarser steps; the report ends with what they cut.
    settings : Settings, optional
        Sizes of the experiments, in place of the choice by `quick`.
    experiments : collection of int, default (1, 2, 3, 4, 5)
        1 static sphere, 2 moving sphere, 3 frame rate, 4 the core and, with a graphics adapter, the compute shader against
        the scalar reference, 5 every collision response, which is ours.
    threads : int, optional
        Threads to use, >= 1. Default: those of the core.
    progress : bool, default False
        Show a progress bar on stderr (needs tqdm).

    Returns
    -------
    dict
        The contents of report.json: "settings", "cuts", "provenance", "experiments" (a mapping from "1" to "5") and
        "folder", which holds report.txt, report.json, index.html, pictures, pages that play experiments 1 and 2, and
        live.html, which leads to the scenes simulated in the browser.

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
    threads = int(cs.build_config()["threads"]) if threads is None else check.integer("threads", threads, minimum=1)
    needed("matplotlib", "the reproduction", "plot")
    settings = settings or (QUICK if quick else FULL)
    folder = check.folder("out", out).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {
        "settings": asdict(settings),
        "cuts": settings.cuts(),
        "provenance": provenance(),
        "experiments": {},
    }

    def bar(number: int, total: int, unit: str) -> ProgressBar:
        return ProgressBar(progress, total=total, unit=unit, desc=f"experiment {number}")

    for number in chosen:
        if number <= 2:
            with bar(number, len(METHODS) * len(VARIANTS) * max(FRAMES[str(number)]), "frame") as shown:
                entry = _contact(str(number), settings, threads, folder, shown.advance)
        elif number == 3:
            with bar(number, 2 * settings.runs, "run") as shown:
                entry = _frame_rates(settings, folder, shown.advance)
        elif number == 4:
            with bar(number, settings.runs * (1 + 2 * len({1, threads})), "run") as shown:
                entry = _speedup(settings, threads, folder, shown.advance)
        else:
            with bar(number, len(SCENES) * len(RESPONSES), "row") as shown:
                entry = _comparison(settings, shown.advance)
        report["experiments"][str(number)] = entry
    report["folder"] = str(folder)
    write_gallery(folder)
    write_bytes(folder / "report.txt", text(report).encode())
    write_bytes(folder / "report.json", (as_json(report) + "\n").encode())
    pages.write_page(folder / "index.html", "clothsim: the experiments of Kim et al.", pages.blocks(report))
    return report


Advance = Callable[[int], object]


def _contact(number: str, settings: Settings, threads: int, folder: Path, advance: Advance) -> dict[str, Any]:
    dt = settings.dt[int(number) - 1]
    cases = contact(number, settings, dt, threads, advance=advance)
    pages.draw_cells(number, cases, settings.picture_width, folder)
    return {
        "title": f"{'static' if number == '1' else 'moving'} sphere, method 1 against method 2",
        "setting": f"RK4 in double precision with steps of {dt:g} s. "
        f"A frame is {settings.frame_dt:g} s, {settings.steps_per_frame()} steps of the paper's {PAPER_DT:g} s: with frames "
        "of one step, as Table 2 reads, the cloth would have fallen by 1.2 mm at the last of them.",
        "dt": dt,
        "cells": [cell for case in cases for cell in case.cells],
        "history": {case.name: case.history for case in cases},
        "failures": {case.name: case.failure for case in cases if case.failure},
        "study": study(settings, threads) if number == "1" else [],
        "page": pages.play(number, cases, folder),
        "live": "live_static.html" if number == "1" else "live_moving.html",
        "plot": pages.plot_history(number, cases, folder),
        "plot_caption": "Deepest triangle and energy gained, frame by frame.",
    }


def _frame_rates(settings: Settings, folder: Path, advance: Advance) -> dict[str, Any]:
    entry = frame_rates(settings, advance)
    return {
        **entry,
        "title": "frame rate, method 1 against method 2",
        "setting": f"The falling cloth of experiment 1 in double precision on one thread, {settings.runs} runs in turns, "
        f"means of every {settings.window_frames} frames of {entry['frame_steps']} steps.",
        "plot": pages.plot_rates(entry, folder),
        "plot_caption": "As Figure 9: median and quartiles of the runs.",
    }


def _speedup(settings: Settings, threads: int, folder: Path, advance: Advance) -> dict[str, Any]:
    entry = speedup(settings, threads, advance)
    return {
        **entry,
        "title": "method 2: core and compute shader against one scalar thread",
        "setting": f"{settings.speedup_steps} steps a run from one state in contact, {settings.runs} runs in turns. "
        "The scalar reference walks the springs one by one, compiled with -O3. "
        f"After 100 steps the positions of core and reference differ by at most {entry['agreement']:.1e} m.",
        "plot": pages.plot_speedup(entry, folder),
        "plot_caption": "As Figure 10: steps per second in each run.",
    }


def _comparison(settings: Settings, advance: Advance) -> dict[str, Any]:
    rows = comparison(part=settings.part, advance=advance)
    scenes = "; ".join(f"{name}: steps of {dt:g} s, {settings.part * end:g} s" for name, (_, dt, end) in SCENES.items())
    setting = f"{scenes}. The moving sphere is that of experiment 2; the fast one comes up at 100 m/s under the level cloth."
    ended = {f"{r['scene']}, {r['response']}": r["failure"] for r in rows if r["failure"]}
    return {
        "title": "every collision response on a static, a moving and a fast sphere",
        "setting": setting,
        "rows": rows,
    } | {"failures": ended}


def _continuous() -> cs.Scene:
    scene = cs.scenes.paper_moving("continuous", offset="cell")
    return scene.replace(spheres=[sphere.replace(restitution=0.0) for sphere in scene.spheres])


GALLERY: dict[str, tuple[str, Callable[[], cs.Scene]]] = {
    "live_static.html": ("Experiment 1: a static sphere", cs.scenes.paper_static),
    "live_moving.html": ("Experiment 2: a moving sphere", cs.scenes.paper_moving),
    "live_swing.html": ("The cloth alone", cs.scenes.paper_swing),
    "live_continuous.html": ("Beyond the paper: the moving sphere, which keeps all triangles out", _continuous),
}


def write_gallery(folder: str | Path) -> Path:
    """Write live.html, which leads to a live page of each of the paper's scenes, and these pages beside it.

    Examples
    --------
    >>> import tempfile
    >>> from clothsim.paper import write_gallery
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_gallery(folder).name
    'live.html'
    """
    folder = Path(folder)
    made: list[tuple[str, Any]] = [("h1", "The scenes of Kim et al., live")]
    made.append(("p", "Each page simulates one scene in your browser, by the compute shader, and makes no request. It needs "
                      "WebGPU. Drag the sphere and the pinned points, and choose the method in the list."))  # fmt: skip
    for name, (title, make) in GALLERY.items():
        scene = make()
        scene.to_live_html(folder / name, title=title)
        picture = folder / name.replace(".html", ".png")
        cs.picture(scene, width=480).save(picture)
        made += [("pictures", (title, [(picture.name, "The scene at its start")])), ("links", {name: title})]
    return pages.write_page(folder / "live.html", "clothsim: the scenes of Kim et al., live", made)
