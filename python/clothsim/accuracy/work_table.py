"""Work-precision as text and as files."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..base.table import aligned, write_csv
from .work_plot import plot_work_precision

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


def write_runs(data: Any, start: str | Path) -> list[Path]:
    """Write a dataset of `work_precision` as CSV and, with matplotlib, as a picture.

    Parameters
    ----------
    data : xarray.Dataset
    start : path-like
        The paths without their endings ``.csv`` and ``.png``.

    Returns
    -------
    list of pathlib.Path
        The written files.

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import write_runs
    >>> data = cs.work_precision(cs.scenes.oscillator(), 0.5, ["rk4"], dts=[0.02], windows=1)
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_runs(data, Path(folder) / "oscillator")[0].name
    'oscillator.csv'
    """
    written = [write_csv(Path(f"{start}.csv"), rows_of(data), data.attrs)]
    if find_spec("matplotlib"):
        written.append(plot_work_precision(data, f"{start}.png"))
    return written


def text_of_runs(data: Any) -> str:
    """A dataset of `work_precision` as a table, method by method.

    Parameters
    ----------
    data : xarray.Dataset

    Returns
    -------
    str
        In the last column, * marks the Pareto front of clothsim and + the front of all solvers.

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import text_of_runs
    >>> data = cs.work_precision(cs.scenes.oscillator(), 0.5, ["rk4"], dts=[0.02], windows=1)
    >>> text_of_runs(data).split()[:2]
    ['solver', 'setting']
    """
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
    legend = (
        "* on the front of clothsim's methods (none is both faster and more accurate), + on that of all\n"
        "s/s: wall time per simulated second; drift: total energy less the reference's"
    )
    return f"{aligned(header, lines, left=(0, 1, 7))}\n{legend}"
