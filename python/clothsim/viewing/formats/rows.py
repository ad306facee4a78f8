"""A table of measures as CSV, with one row per stored frame."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = (
    "time_s",
    "kinetic_J",
    "elastic_J",
    "gravity_J",
    "force_J",
    "total_J",
    "largest_stretch",
    "penetration_points_m",
    "penetration_triangles_m",
)


def measures(run: Any) -> np.ndarray:
    """The columns of the table, with one row per stored frame.

    Depths are the deepest over the spheres at the time of the frame.
    """
    energies, depths = run.energy(), run.penetration()
    kinds = (energies[name] for name in ("kinetic", "elastic", "gravity", "force", "total"))
    return np.column_stack([run.t, *kinds, run.stretch()["largest"], depths["points"], depths["triangles"]])


def write(run: Any, path: Path) -> list[Path]:
    with path.open("w", encoding="ascii", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        table.writerows(measures(run).tolist())
    return [path]
