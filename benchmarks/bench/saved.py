"""The bench's files: one small CSV of a run, written and read, and plots."""

from __future__ import annotations

import csv
import json
import statistics
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from . import plots
from .figures import Figure, Figures, Measured, attempt
from .machine_facts import slug
from .settings import FULL, NORMAL, QUICK, SECTIONS, Settings

COLUMNS = (
    "work",
    "by",
    "precision",
    "threads",
    "instruction_set",
    "strict",
    "points",
    "springs",
    "minimum_us",
    "median_us",
    "error",
    "error_steps",
    "flops",
)
"""Times are microseconds per step in four digits, errors have two; an empty cell is None or False."""

_ABOUT = ("cpu", "family", "model", "stepping", "cores", "system", "load_average", "created")
_OF_BUILD = ("version", "compiler", "instruction_set", "instruction_sets_supported")
_LABELS = ("work", "by", "precision", "threads", "instruction_set", "strict", "points", "springs")


def name(report: dict[str, Any]) -> str:
    """Start of the names of a run's files: the machine, and the parts of a whole run that are missing.

    A whole run has all sections and the settings `NORMAL` or `FULL`. Other runs have "-quick" or "-custom" (own
    settings) after the machine, and then their sections if some are missing.
    """
    settings = Settings(**report["settings"])
    lacks = [] if settings in (NORMAL, FULL) else ["quick" if settings == QUICK else "custom"]
    if set(report["sections"]) != set(SECTIONS):
        lacks += report["sections"]
    return "-".join([slug(report["machine"]), *lacks])


def write(report: dict[str, Any], folder: Path) -> None:
    """Write `report` into `folder` as CSV and, where matplotlib is there, plots.

    The paths go to report["files"]. The comparison with an earlier file of the same name goes to
    report["before"], and the reason of a missing plot to report["skipped"]. Plots come last, so that an error in a plot
    loses no measurement.
    """
    folder.mkdir(parents=True, exist_ok=True)
    start = str(folder / name(report))
    if report["figures"]:
        path = Path(f"{start}.csv")
        report["before"] = attempt(partial(compare, report, path), None, report["skipped"], file=path.name)
        write_csv(report, path)
        report["files"].append(str(path))
    _draw(report, start)


def write_csv(report: dict[str, Any], path: Path) -> None:
    """The figures of `report`, after machine, settings and limits as lines of JSON that begin with #."""
    about = report["machine"]
    head = {
        "machine": {
            **{key: about[key] for key in _ABOUT if key in about},
            "build": {key: about["build"][key] for key in _OF_BUILD if key in about["build"]},
        },
        "settings": report["settings"],
        "sections": report["sections"],
        "limits": report["limits"],
        "accuracy": report["accuracy"],
    }
    with path.open("w", newline="", encoding="utf-8") as file:
        for key, value in head.items():
            file.write(f"# {key}: {json.dumps(_short(value), separators=(',', ':'))}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(_cells(figure) for figure in report["figures"])


def read(path: Path) -> Measured:
    """Read a run from a file of `write_csv`."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = {}
    for line in lines:
        if line.startswith("# "):
            key, _, value = line[2:].partition(": ")
            head[key] = json.loads(value)
    figures = Figures()
    figures.add(_figure(row) for row in csv.DictReader(line for line in lines if not line.startswith("#")))
    core = [f for f in figures if f.instruction_set]
    first = head["machine"]["build"]["instruction_set"]
    return Measured(
        figures,
        kernels=tuple(dict.fromkeys(f.by for f in core)),
        instruction_sets=tuple(dict.fromkeys([first, *(f.instruction_set for f in core)])),
        threads=tuple(sorted({f.threads for f in figures if f.threads})),
        limits=_limits(head["limits"]),
        accuracy=head["accuracy"],
    )


def compare(report: dict[str, Any], path: Path) -> str | None:
    """Ratio of the time of steps to the time in the saved run; None without a saved run."""
    if not path.exists():
        return None
    earlier = {tuple(getattr(f, key) for key in _LABELS): f.minimum for f in read(path).figures}
    times = [(f["minimum"], earlier.get(tuple(f[key] for key in _LABELS))) for f in report["figures"]]
    ratios = sorted(now / before for now, before in times if before)
    if not ratios:
        return None
    return (
        f"Least times over those that {path.name} had: median {statistics.median(ratios):.3f}, "
        f"from {ratios[0]:.3f} to {ratios[-1]:.3f} ({len(ratios)} figures)"
    )


def _cells(figure: dict[str, Any]) -> list[Any]:
    error = None if figure["error"] is None else float(f"{figure['error']:.2g}")
    row = {**figure, "error": error, "minimum_us": 1e6 * figure["minimum"], "median_us": 1e6 * figure["median"]}
    return [_cell(row[column]) for column in COLUMNS]


def _cell(value: Any) -> Any:
    return "" if value is None or value is False else 1 if value is True else _short(value)


def _short(value: Any) -> Any:
    """The same mapping with numbers rounded to four digits."""
    if isinstance(value, dict):
        return {key: _short(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_short(one) for one in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _figure(row: dict[str, str]) -> Figure:
    def whole(column: str) -> int | None:
        return int(row[column]) if row[column] else None

    return Figure(
        work=row["work"],
        by=row["by"],
        precision=row["precision"],
        threads=whole("threads"),
        instruction_set=row["instruction_set"],
        strict=bool(row["strict"]),
        points=int(row["points"]),
        springs=int(row["springs"]),
        minimum=1e-6 * float(row["minimum_us"]),
        median=1e-6 * float(row["median_us"]),
        windows=0,
        steps=0,
        error=float(row["error"]) if row["error"] else None,
        error_steps=whole("error_steps"),
        flops=whole("flops"),
    )


def _limits(plain: dict[str, Any]) -> dict[str, Any]:
    """The limits as `machine_facts.limits` gives them: keys of JSON are texts."""
    if not plain:
        return {}
    peak = {(p["instruction_set"], p["precision"], p["threads"]): p["flops_per_second"] for p in plain["peak"]}
    rest = {
        key: {int(n): rate for n, rate in value.items()} if isinstance(value, dict) else value
        for key, value in plain.items()
    }
    return {**rest, "peak": peak}


def _draw(report: dict[str, Any], start: str) -> None:
    if find_spec("matplotlib") is None:
        reason = "matplotlib is not installed: run pip install '.[bench]' in a clone of clothsim"
        report["skipped"].append({"plot": "all", "reason": reason})
        return

    def save(what: str) -> None:
        figure = plots.ALL[what](report)
        if figure is not None:
            figure.savefig(f"{start}-{what}.png", dpi=120)
            report["files"].append(f"{start}-{what}.png")

    for what in plots.ALL:
        attempt(partial(save, what), None, report["skipped"], plot=what)
