"""Pictures of the contact experiments: one a cell, one sheet a table, one for the README."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import clothsim as cs

from . import raster
from .contact import Case, Experiment, scene_of
from .settings import Settings

FRONT = (1.0, 0.6, 1.3)
BACK = (-0.6, 0.9, 0.7)
BACK_FRAMES = {"2": (200,)}  # the paper draws this frame from the back face
STAGE = (-1.1, -1.1, -0.2), (1.1, 0.2, 1.2)  # m; what a cloth that is thrown about leaves is cut
PIN_RADIUS = 0.013  # m


def draw_cells(
    experiment: Experiment, cases: Sequence[Case], settings: Settings, folder: Path
) -> None:
    """Write the picture of each cell and enter its path, relative to `folder`, in the cell.

    All cells of a frame share one camera, which holds the sphere and every cloth within `STAGE`.
    """
    from matplotlib.image import imsave

    (folder / experiment.table).mkdir(parents=True, exist_ok=True)
    for frame in experiment.frames:
        camera = _camera(experiment, cases, frame)
        for case in cases:
            for cell in case.cells:
                if cell["frame"] == frame:
                    name = f"frame{frame}_method{case.method}_{case.variant}.png"
                    cell["picture"] = f"{experiment.table}/{name}"
                    picture = _draw(experiment, case, frame, camera, settings.picture_size)
                    imsave(folder / cell["picture"], picture)


def _camera(experiment, cases, frame) -> raster.Camera:
    direction = BACK if frame in BACK_FRAMES.get(experiment.number, ()) else FRONT
    points = []
    for case in cases:
        if frame in case.states:
            positions, time = case.states[frame]
            points += [np.clip(positions.reshape(-1, 3), *STAGE)]
            points += _extremes(experiment, case, time, direction)
    if not points:  # no case got this far; nothing will be drawn
        return raster.Camera(direction, (0.0, 0.0, 0.0), 1.0)
    return raster.Camera.around(direction, np.concatenate(points))


def _extremes(experiment, case, time, direction):
    """The ends of the sphere's outline along the picture's axes."""
    sphere = scene_of(experiment, case.method, case.variant).spheres[0]
    axes = raster.Camera(direction, (0.0, 0.0, 0.0), 1.0).axes()
    center = np.asarray(sphere.center_at(time))
    return [center + sphere.radius * axes[:2], center - sphere.radius * axes[:2]]


def _draw(experiment, case, frame, camera, size) -> np.ndarray:
    positions, time = case.states[frame]
    scene = scene_of(experiment, case.method, case.variant)
    balls = [raster.Ball(s.center_at(time), s.radius, raster.SPHERE) for s in scene.spheres]
    balls += [
        raster.Ball(positions[row, column], PIN_RADIUS, raster.PIN, solid=False)
        for row, column in np.argwhere(scene.cloth.pinned)
    ]
    triangles = cs.triangles(positions.shape[:2])
    return raster.render(positions, triangles, balls, camera, (size, size))


def draw_sheet(experiment: Experiment, cases: Sequence[Case], folder: Path) -> str:
    """All cells of a table in one picture with its numbers; its path relative to `folder`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    rows, columns = len(experiment.frames), len(cases)
    figure = Figure(figsize=(3.2 * columns, 3.5 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for (row, column), panel in np.ndenumerate(axes):
        case, frame = cases[column], experiment.frames[row]
        cell = next((c for c in case.cells if c["frame"] == frame), None)
        panel.set(xticks=[], yticks=[])
        panel.spines[:].set_visible(False)
        if row == 0:
            panel.set_title(f"method {case.method}, {case.variant}", weight="bold")
        if cell is None:
            panel.text(0.5, 0.5, "no finite state", ha="center", transform=panel.transAxes)
            continue
        if column == 0:
            panel.set_ylabel(f"frame {frame}, t = {cell['time']:.2f} s", weight="bold")
        panel.imshow(imread(folder / cell["picture"]), interpolation="antialiased")
        depth = cell["penetration"]
        panel.set_xlabel(
            f"deepest point {1e3 * depth['points']:.3g} mm, "
            f"triangle {1e3 * depth['triangles']:.3g} mm"
        )
    name = f"{experiment.table}.png"
    figure.savefig(folder / name, dpi=110)
    return name


def draw_overview(drawn: Sequence[tuple[Experiment, Sequence[Case]]], folder: Path) -> str:
    """Method 2, mended, through both experiments side by side: the README's picture."""
    from matplotlib.image import imread, imsave

    strip = []
    for experiment, cases in drawn:
        case = next(c for c in cases if c.method == 2 and c.variant == "mended")
        strip += [imread(folder / cell["picture"])[..., :3] for cell in case.cells]
    imsave(folder / "overview.png", np.concatenate(strip, axis=1))
    return "overview.png"
