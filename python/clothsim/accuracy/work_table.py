"""Work-precision as text and as CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..lab.peers.front import PEER_FACTOR, TARGETS, Front, statement

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
    """One mapping per run of a dataset of `work_precision`; levels that are not there left out."""
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
    """The runs of a dataset of `work_precision`, one a line, after its attributes as # lines."""
    with path.open("w", newline="") as file:
        for name, value in data.attrs.items():
            file.write(f"# {name}: {value}\n")
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows_of(data))


def text_of_runs(data: Any) -> str:
    """A table of the runs, method by method; * marks the front of this package's, + that of all."""
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
    return _aligned(header, lines, left=(0, 1, 7))


def text_of_front(found: Front) -> str:
    """At each error the fastest choice, the next method and the best peer."""
    header = (
        "rms error [m]",
        "fastest",
        "setting",
        "evaluations",
        "s/s",
        "next method",
        "slower",
        "best peer",
        "s/s",
        "slower",
    )
    lines = []
    for one in statement(found):
        lines.append(
            (
                f"{one['error']:.0e}",
                one["fastest"] or "none",
                _number(one["setting"], ".2e"),
                _number(one["force_evaluations"], "d"),
                _number(one["wall_time"], ".4f"),
                one["next"] or "none",
                _number(one["next_ratio"], ".2f", "x"),
                one["peer"] or "none",
                _number(one["peer_wall_time"], ".4f"),
                _number(one["peer_ratio"], ".2f", "x"),
            )
        )
    text = _aligned(header, lines, left=(0, 1, 5, 7))
    return text + "".join(f"\nNot measured: {reason}" for reason in found.missing)


def targets_of(found: Front) -> list[dict[str, Any]]:
    """`TARGETS` beside what `found`, made at their errors, has."""
    measured = {one["error"]: one for one in statement(found)}
    result = []
    for target in TARGETS:
        one = measured[target.error]
        reached = one["wall_time"] is not None and one["wall_time"] <= target.wall_time
        beaten = None if one["peer_ratio"] is None else one["peer_ratio"] >= PEER_FACTOR
        result.append({"target": target.wall_time, "reached": reached, "beaten": beaten, **one})
    return result


def text_of_targets(found: Front) -> str:
    """Each target, what was measured and how much slower the best peer is."""
    header = (
        "rms error [m]",
        "target s/s",
        "measured s/s",
        "reached",
        "by",
        "setting",
        "best peer",
        "s/s",
        "slower",
        f">= {PEER_FACTOR:g}x",
    )
    words = {True: "yes", False: "no", None: "-"}
    lines = [
        (
            f"{one['error']:.0e}",
            f"{one['target']:.3f}",
            _number(one["wall_time"], ".4f"),
            words[one["reached"]],
            one["fastest"] or "none",
            _number(one["setting"], ".2e"),
            one["peer"] or "none",
            _number(one["peer_wall_time"], ".4f"),
            _number(one["peer_ratio"], ".2f", "x"),
            words[one["beaten"]],
        )
        for one in targets_of(found)
    ]
    text = _aligned(header, lines, left=(0, 3, 4, 6, 9))
    return text + "".join(f"\nNot measured: {reason}" for reason in found.missing)


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else f"{value:{form}}{unit}"


def _aligned(header: Sequence[str], lines: Iterable[Sequence[str]], left: Sequence[int]) -> str:
    table = [header, *lines]
    widths = [max(len(row[k]) for row in table) for k in range(len(header))]
    return "\n".join(
        "  ".join(
            f"{cell:<{width}}" if k in left else f"{cell:>{width}}"
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    )
