"""Pictures of the contact experiments: one per cell, one sheet per table, one for the README."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

import clothsim as cs
from clothsim.typing import Report

from ..base.plots import figure, save
from ..viewing.camera import camera_for
from . import responses as contact
from .paper_report import number
from .paper_settings import Settings
from .responses import Case, Experiment

FRONT = (1.0, 0.6, 1.3)
BACK = (-0.6, 0.9, 0.7)
BACK_FRAMES = {"2": (200,)}  # the paper draws this frame from the back face
STAGE = (-1.2, -1.6, -0.6), (1.6, 1.1, 1.6)  # m; mass points that a collision throws further are cut
OVERVIEW_HEIGHT = 420  # pixels
LABELLED = 320  # pixels; the least width of a picture that has room for a scale
# (which of the experiment's frames, method, variant)
OVERVIEW = {"1": ((1, 2, "corrected"), (2, 2, "corrected")), "2": ((0, 1, "as printed"), (0, 2, "corrected"))}


def draw_cells(experiment: Experiment, cases: Sequence[Case], settings: Settings, folder: Path) -> None:
    """Write the picture of each cell and enter its path, relative to `folder`, in the cell.

    Each cell has a camera that holds its sphere and its cloth within `STAGE`. A strip below it states the scale, where the
    picture is wide enough.
    """
    from matplotlib.image import imsave

    (folder / experiment.table).mkdir(parents=True, exist_ok=True)
    for frame in experiment.frames:
        reached = [case for case in cases if frame in case.states]
        if not reached:
            continue
        for case in reached:
            camera = _camera(experiment, case, frame)
            cell = next(cell for cell in case.cells if cell["frame"] == frame)
            name = f"frame{frame}_method{case.method}_{case.variant.replace(' ', '_')}.png"
            cell["picture"] = f"{experiment.table}/{name}"
            picture = _draw(experiment, case, frame, camera, settings.picture_width)
            imsave(folder / cell["picture"], picture)


def _direction(experiment: Experiment, frame: int) -> tuple[float, float, float]:
    return BACK if frame in BACK_FRAMES.get(experiment.number, ()) else FRONT


def _camera(experiment: Experiment, case: Case, frame: int) -> cs.Camera:
    positions, time = case.states[frame]
    scene = contact.scene_of(experiment, case.method, case.variant)
    return camera_for(_direction(experiment, frame), scene, np.clip(positions, *STAGE)[None], [time])


def _draw(experiment: Experiment, case: Case, frame: int, camera: cs.Camera, width: int, label: bool = True) -> np.ndarray:
    positions, time = case.states[frame]
    scene = contact.scene_of(experiment, case.method, case.variant)
    return cs.picture(scene, positions, time, camera=camera, width=width, label=label and width >= LABELLED).pixels


def draw_sheet(experiment: Experiment, cases: Sequence[Case], folder: Path) -> str:
    """All cells of a table in one picture with its numbers; its path relative to `folder`."""
    from matplotlib.image import imread

    cells = {(cell["frame"], k): cell for k, case in enumerate(cases) for cell in case.cells}
    pictures = {key: imread(folder / cell["picture"]) for key, cell in cells.items()}
    heights = []
    for frame in experiment.frames:
        shapes = [p.shape for (f, _), p in pictures.items() if f == frame]
        heights.append(max((rows / columns for rows, columns, _ in shapes), default=0.3) + 0.12)
    size = 3.2 * len(cases), 3.2 * sum(heights) + 0.4
    drawn, axes = figure(*size, len(heights), len(cases), height_ratios=heights)
    for (row, column), panel in np.ndenumerate(axes):
        case, frame = cases[column], experiment.frames[row]
        panel.set(xticks=[], yticks=[])
        panel.spines[:].set_visible(False)
        if row == 0:
            panel.set_title(f"method {case.method}, {case.variant}", weight="bold")
        if (frame, column) not in cells:
            panel.text(0.5, 0.5, "no finite state", ha="center", transform=panel.transAxes)
            continue
        cell = cells[frame, column]
        if column == 0:
            panel.set_ylabel(f"frame {frame}, t = {cell['time']:.2f} s", weight="bold")
        panel.imshow(pictures[frame, column], interpolation="antialiased")
        depth = cell["penetration"]
        panel.set_xlabel(f"deepest point {number(1e3 * depth['points'])} mm, triangle {number(1e3 * depth['triangles'])} mm")
    name = f"{experiment.table}.png"
    save(drawn, folder / name)
    return name


def play(experiment: Experiment, cases: Sequence[Case], folder: Path) -> str:
    """A page that plays all cases of a table in step; its path relative to `folder`."""
    runs = {}
    for case in cases:
        t, x, v = map(np.array, zip(*case.played))
        scene = contact.scene_of(experiment, case.method, case.variant)
        runs[f"method {case.method}, {case.variant}"] = cs.Run(scene, t, x, v, cast(Report, {}))
    name = f"{experiment.table}.html"
    title = f"Table {experiment.table.removeprefix('table')}: {experiment.title}"
    cs.compare(runs).to_html(folder / name, title=title)
    return name


def draw_overview(drawn: Sequence[tuple[Experiment, Sequence[Case]]], folder: Path) -> str | None:
    """The `OVERVIEW` cells side by side with captions, for the README; None where there are none."""
    strip, captions = [], []
    for experiment, cases in drawn:
        for at, method, variant in OVERVIEW[experiment.number]:
            frame = experiment.frames[min(at, len(experiment.frames) - 1)]
            case = next(c for c in cases if (c.method, c.variant) == (method, variant))
            if frame in case.states:
                camera = _camera(experiment, case, frame)
                width = round(OVERVIEW_HEIGHT * camera.width / camera.height)
                strip.append(_draw(experiment, case, frame, camera, width, label=False))
                captions.append(
                    f"Experiment {experiment.number}, t = {case.states[frame][1]:.2f} s\nmethod {method}, {variant}"
                )
    if not strip:
        return None
    widths = [picture.shape[1] / picture.shape[0] for picture in strip]
    overview, (panels,) = figure(3.4 * sum(widths), 3.9, 1, len(strip), width_ratios=widths)
    for panel, picture, caption in zip(panels, strip, captions, strict=True):
        panel.imshow(picture, interpolation="antialiased")
        panel.set(xticks=[], yticks=[], xlabel=caption)
        panel.spines[:].set_visible(False)
    save(overview, folder / "overview.png")
    return "overview.png"
