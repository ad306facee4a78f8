"""The bench's files: CSV and plots."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from .machine import slug


def write(report: dict[str, Any], folder: Path) -> list[str]:
    """Write the figures as CSV and, where matplotlib is there, the plots; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    name = slug(report["machine"])
    path = folder / f"{name}.csv"
    about = {
        "cpu": report["machine"]["cpu"],
        "load": (report["machine"]["load_average"] or [None])[0],
        "created": report["machine"]["created"],
        "version": report["machine"]["build"]["version"],
    }
    with path.open("w", newline="") as file:
        rows = [{**figure, **about} for figure in report["figures"]]
        writer = csv.DictWriter(file, rows[0] if rows else about)
        writer.writeheader()
        writer.writerows(rows)
    targets = folder / f"{name}-targets.csv"
    with targets.open("w", newline="") as file:
        writer = csv.DictWriter(file, report["targets"][0])
        writer.writeheader()
        writer.writerows(report["targets"])
    files = [str(path), str(targets)]
    try:
        from . import plots

        files += plots.draw(report, folder, name)
    except ImportError:
        report["skipped"].append(
            {"by": "plots", "reason": "matplotlib is not installed: pip install 'clothsim[bench]'"}
        )
    return files
