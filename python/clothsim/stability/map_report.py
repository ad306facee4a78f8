"""Stability for people: the map as a table, a picture and a CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..base.extras import needed
from .map import StabilityMap


def map_table(found: StabilityMap) -> str:
    """Table with a row per time step and a column per stiffness: ``o`` is stable, ``x`` is not. Cells are marked where
    the prediction differs.
    """
    width = 9
    head = "dt [s] \\ K [N/m]"

    def row(name: str, cells: Iterable[str]) -> str:
        return f"{name:<16}" + "".join(f"{cell:>{width}}" for cell in cells)

    lines = [row(head, (f"{k:.2g}" for k in found.stiffness))]
    for j in np.argsort(found.dt)[::-1]:
        marks = ("o" if s else "x" for s in found.stable[:, j])
        agree = (m if s == p else m + "!" for m, s, p in zip(marks, found.stable[:, j], found.predicted[:, j]))
        lines.append(row(f"{found.dt[j]:.3e}", agree))
    lines.append(row("predicted limit", (f"{h:.2e}" for h in found.limit)))
    lines.append(row("guaranteed", (f"{h:.2e}" for h in found.guarantee)))
    differing = int((found.stable != found.predicted).sum())
    lines.append(
        f"o stable, x unstable over {found.steps} steps of {found.integrator} in {found.precision}; "
        f"! where the prediction differs: {differing} of {found.stable.size} cells"
    )
    return "\n".join(lines)


def write_csv(found: StabilityMap, path: Path) -> None:
    """One row a cell."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["stiffness", "dt", "stable", "predicted", "limit", "guarantee"])
        for i, k in enumerate(found.stiffness):
            for j, dt in enumerate(found.dt):
                cells = (int(found.stable[i, j]), int(found.predicted[i, j]))
                writer.writerow([float(k), float(dt), *cells, found.limit[i], found.guarantee[i]])


def need_matplotlib() -> None:
    """Raise an ImportError that names the extra, where matplotlib is missing."""
    needed("matplotlib", "a picture", "plot")


def draw_map(found: StabilityMap, path: Path) -> None:
    """Plot stable and unstable runs, with lines of the predicted limit and the guarantee."""
    need_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 5), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    k, dt = np.meshgrid(found.stiffness, found.dt, indexing="ij")
    for mask, color, marker, label in (
        (found.stable, "tab:blue", "o", "stable"),
        (~found.stable, "tab:red", "x", "unstable"),
    ):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    order = np.argsort(found.stiffness)
    for values, style, label in (
        (found.limit, "-", "predicted limit"),
        (found.guarantee, "--", "guaranteed (max_stable_dt)"),
    ):
        if np.isfinite(values).any():
            axes.plot(found.stiffness[order], values[order], "k" + style, label=label)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=f"{found.integrator}, {found.precision}: {found.steps} steps",
    )
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path)
