"""Summary that `clothsim sweep` prints of its result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from clothsim.sweeps import METRICS

_OWN = ("status", "max_stable_dt", "unstable_step", "unstable_time", "message")


def summary(dataset: Any) -> str:
    """Number of members by status, and each metric as a table, or as its range where a table is too large."""
    status = dataset["status"].values
    session = dataset.clothsim.provenance["sessions"][-1]
    counts = ", ".join(
        f"{int((status == code).sum())} {name}"
        for code, name in enumerate(("pending", "done", "unstable", "failed"))
        if (status == code).any()
    )
    work = "nothing was missing"
    if session["tasks"]:
        each = session["task_seconds"] / session["tasks"]
        work = f"{session['wall_time']:.1f} s, tasks: {session['tasks']} of {each:.2f} s"
    lines = [f"{status.size} members ({counts}); {work}"]
    for name, variable in dataset.data_vars.items():
        if name not in _OWN and variable.dims == dataset["status"].dims:
            lines += ["", *_table(dataset, str(name))]
    return "\n".join(lines)


def _table(dataset: Any, name: str) -> list[str]:
    variable = dataset[name]
    unit = variable.attrs.get("units", "1")
    title = name + (f" [{unit}]" if unit != "1" else "")
    secondary = name not in METRICS and any(name in m.variables for m in METRICS.values())
    if secondary or variable.ndim not in (1, 2) or max(variable.shape) > 24 or min(variable.shape) > 8:
        values = variable.values[dataset["status"].values == 1]
        if not values.size:
            return [f"{title}: no member came to its end"]
        return [f"{title}: {values.min():.4g} to {values.max():.4g}"]
    if variable.ndim == 2 and variable.shape[1] > variable.shape[0]:
        variable = variable.transpose()
    status = dataset["status"].transpose(*variable.dims).values
    rows, *columns = variable.dims
    head = [[rows, title]]
    if columns:
        head = [[rows, *(f"{columns[0]} {text}" for text in _labels(dataset, columns[0]))]]
    body = [
        [at, *(_cell(v, s) for v, s in zip(_row(values), _row(states), strict=True))]
        for at, values, states in zip(_labels(dataset, rows), variable.values, status, strict=True)
    ]
    widths = [max(map(len, column)) for column in zip(*head, *body, strict=True)]
    table = ["  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in [*head, *body]]
    return [title, *table]


def _labels(dataset: Any, dimension: str) -> list[str]:
    """Labels along a dimension. For zipped lists and samples, a label has all values of the member."""
    own = dataset[dimension]
    if own.attrs:  # else they are mere numbers
        return [_text(value) for value in own.values]
    names = [n for n, c in dataset.coords.items() if c.dims == (dimension,) and n != dimension]
    columns = [[f"{name}={_text(value)}" for value in dataset[name].values] for name in names]
    return [" ".join(texts) for texts in zip(*columns, strict=True)]


def _row(values: Any) -> Sequence[Any]:
    return values if getattr(values, "ndim", 0) else [values]


def _cell(value: Any, status: int) -> str:
    if status != 1 and str(value) != "False":
        return ("pending", "", "unstable", "failed")[status]
    return str(value) if str(value) in ("True", "False") else f"{value:.4g}"


def _text(value: Any) -> str:
    if value != value:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def as_data(dataset: Any) -> dict[str, Any]:
    """Coordinates, variables and provenance, for JSON."""
    coordinates = {
        str(name): {"dims": list(c.dims), "values": c.values, "units": c.attrs.get("units")}
        for name, c in dataset.coords.items()
    }
    variables = {
        str(name): {"dims": list(v.dims), "values": v.values, "units": v.attrs.get("units")}
        for name, v in dataset.data_vars.items()
    }
    return {"coordinates": coordinates, "variables": variables, "provenance": dataset.clothsim.provenance}
