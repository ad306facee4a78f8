"""Work-precision as text and as CSV."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

from ..base.table import aligned

COLUMNS = (
    "solver",
    "library",
    "precision",
    "threads",
    "control",
    "setting",
    "rms_error",
    "max_error",
    "force_evaluations",
    "wall_time",
    "energy_drift",
    "pareto",
    "pareto_all",
)


def rows_of(data: Any) -> list[dict[str, Any]]:
    """One mapping for each run in a dataset of `work_precision`."""
    rows = []
    for m, name in enumerate(data["solver"].values):
        labels = {c: data[c].values[m] for c in ("library", "precision", "threads", "control")}
        for level in range(data.sizes["level"]):
            values = {c: data[c].values[m, level] for c in COLUMNS if c not in labels and c != "solver"}
            if not math.isnan(values["setting"]):
                plain = {key: getattr(v, "item", lambda v=v: v)() for key, v in values.items()}
                rows.append({"solver": str(name), **labels, **plain})
    return rows


def write_csv(data: Any, path: Path) -> None:
    """Write a dataset of `work_precision` as CSV: its attributes as lines that begin with #, then one line per run."""
    with path.open("w", newline="") as file:
        for name, value in data.attrs.items():
            file.write(f"# {name}: {value}\n")
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows_of(data))


def text_of_runs(data: Any) -> str:
    """A table of the runs, method by method: * marks the Pareto front of clothsim, + the front of all solvers."""
    peers = len(set(data["library"].values.tolist())) > 1
    header = ("solver", "setting", "rms [m]", "max [m]", "evaluations", "s/s", "drift [J]", "front")
    lines = []
    for row in rows_of(data):
        unstable = math.isinf(row["rms_error"])
        lines.append(
            (
                row["solver"],
                f"{row['control']} {row['setting']:.2e}",
                "unstable" if unstable else f"{row['rms_error']:.1e}",
                "" if unstable else f"{row['max_error']:.1e}",
                "" if unstable else f"{row['force_evaluations']:.0f}",
                "" if unstable else f"{row['wall_time']:.4f}",
                "" if unstable else f"{row['energy_drift']:.1e}",
                "*" * row["pareto"] + "+" * (row["pareto_all"] and peers),
            )
        )
    return aligned(header, lines, left=(0, 1, 7))
