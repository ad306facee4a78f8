"""Plots by matplotlib: curves of a run, and pictures of Datasets of `sweep`, `stability_map` and `work_precision`.

Each function for a Dataset draws on the matplotlib axes `ax`, or on those of a new figure, and returns the axes.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ..accuracy.plots import draw_work_precision, look_of
from ..base import Floats, check
from ..base.extras import needed
from ..base.plots import BLACK, BLUE, DPI, GREEN, GREY, LIGHT_GREY, RED, YELLOW, figure, save, shown_axes, style
from ..model.scene import Scene
from ..stability.map import draw_map
from ..sweeps.member import STATUS
from ..sweeps.metrics import RESERVED
from .picture import file_path

# A mass point touches a sphere if it is closer than the contact radius and this part of the spacing. Half of it misses
# points that bounce while they rest, twice of it counts points that only pass.
TOUCH = 1 / 32


def touching(scene: Scene, x: Floats, t: float) -> int:
    """Number of mass points that touch a sphere at the time `t`."""
    near = TOUCH * max(scene.cloth.spacing)
    touched = np.zeros(scene.cloth.shape, bool)
    for sphere in scene.spheres:
        touched |= sphere.height(x, t) <= sphere.offset_length(scene.cloth) + near
    return int(touched.sum())


def curves(run: Any) -> dict[str, Floats]:
    """Each curve, shape (frames,).

    "kinetic", "elastic", "gravity", "force" and "total" [J]; "stretch" of the most stretched spring, l/L - 1;
    "points" and "triangles", the deepest of each below the true radius of any sphere [m]; "contacts",
    the number of mass points that touch a sphere. Without a sphere the last three are missing.
    """
    found: dict[str, Floats] = {**run.energy(), "stretch": run.stretch()["largest"]}
    if run.scene.spheres:
        found |= run.penetration()
        found["contacts"] = np.array([touching(run.scene, x, float(t)) for x, t in zip(run.x, run.t)], float)
    return found


# Name of a curve: colour, dash (which repeats the message of the colour), width.
STYLES = {
    "total": (BLACK, "-", 2.0),
    "kinetic": (RED, "--", 1.5),
    "elastic": (GREEN, "-.", 1.5),
    "gravity": (BLUE, ":", 2.0),
    "points": (BLUE, "-", 1.5),
    "triangles": (RED, "--", 1.5),
}
PANELS = (
    ("energy [J]", 1.0, ("total", "kinetic", "elastic", "gravity")),
    ("largest stretch [%]", 100.0, ("stretch",)),
    ("penetration [mm]", 1000.0, ("points", "triangles")),
    ("points in contact", 1.0, ("contacts",)),
)
LABELS = {"points": "deepest point", "triangles": "deepest triangle"}


def plot_run(run: Any, path: str | Path | None = None) -> Any:
    """`Run.plot`: the figure, for a notebook. It is also written to `path` if a path is given."""
    base = needed("matplotlib.figure", "run.plot", "plot").Figure
    path = None if path is None else file_path("path", path)
    formats = base().canvas.get_supported_filetypes()
    if path is not None and path.suffix.lower()[1:] not in formats:
        raise ValueError(f"path must end in one of {', '.join(f'.{name}' for name in formats)}, got {str(path)!r}")

    class Plot(base):  # type: ignore[misc, valid-type]
        """A figure that a notebook shows without a choice of a backend."""

        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, dpi=DPI)
            return file.getvalue()

    found = curves(run)
    panels = [panel for panel in PANELS if panel[2][0] in found]
    drawn, axes = figure(8, 0.8 + 1.6 * len(panels), len(panels), what="run.plot", base=Plot, sharex=True)
    few: dict[str, Any] = {"marker": "o", "ms": 3} if len(run.t) < 20 else {}
    for axis, (label, scale, names) in zip(axes[:, 0], panels, strict=True):
        for name in names:
            color, dash, width = STYLES.get(name, (BLACK, "-", 1.5))
            look = {"label": LABELS.get(name, name), "color": color, "ls": dash, "lw": width, **few}
            axis.plot(run.t, scale * found[name], clip_on=False, **look)
        axis.set(ylabel=label, xmargin=0)
        if not any((found[name] < 0).any() for name in names):
            axis.set_ylim(bottom=0)
        if len(names) > 1:
            axis.legend(fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    axes[-1, 0].set_xlabel("time [s]")
    drawn.align_ylabels()
    if path is not None:
        save(drawn, path)
    return drawn


KINDS = ("convergence", "stability", "heatmap")
UNSTABLE = STATUS.index("unstable")
TELLING = ("error", "sag", "penetration", "largest_stretch")  # metrics that a heat map shows first
UNSURE = "below the\nreference's own"  # label of errors that the reference does not tell
HOLLOW = {"ms": 4, "mec": GREY, "mfc": "white", "ls": "none", "zorder": 3, "label": UNSURE}


def plot(dataset: Any, kind: str | None = None, **options: Any) -> Any:
    """Draw a sweep: `convergence`, `stability`, `heatmap` or the plot that suits it best. Other Datasets have one plot."""
    if "solver" in dataset.dims or "predicted" in dataset:
        if kind is not None:
            raise ValueError(f"kind must be None for a Dataset that is of no sweep, got {kind!r}")
        return (draw_work_precision if "solver" in dataset.dims else draw_map)(dataset, **options)
    if "status" not in dataset:
        raise ValueError("dataset must be of sweep, stability_map or work_precision, got one without their variables")
    draw: dict[str, Callable[..., Any]] = {"convergence": convergence, "stability": stability, "heatmap": heatmap}
    return draw[check.choice("kind", kind or suggested(dataset), KINDS)](dataset, **options)


def suggested(dataset: Any) -> str:
    """The plot that suits this sweep best."""
    if "error" in dataset and _steered_by(dataset):
        return "convergence"
    by_outcome = "dt" in dataset.dims and len(_long(dataset)) > 1 and not {*TELLING[:3]} & {*dataset.data_vars}
    return "stability" if by_outcome else "heatmap"


def _steered_by(dataset: Any) -> str | None:
    """The dimension that controls the error."""
    return next((name for name in ("dt", "rtol", "atol") if name in dataset.dims), None)


def convergence(dataset: Any, along: str | None = None, ax: Any = None) -> Any:
    """Error over dt, rtol or atol, a line for each value of the dimension `along` (the convergence fan).

    Select a value of each further dimension first. Crosses at the top mark steps that diverged. The dotted line over dt is
    the slope of order 4. Hollow circles are errors below the error bound of the reference.
    """
    by = _steered_by(dataset) or "dt"
    _require(dataset, "error", by)
    along = _other(dataset, along, [d for d in _long(dataset) if d != by])
    dataset = _reduced(dataset, by, along)
    (ax,) = shown_axes(ax)
    x = dataset[by].values
    lines = [dataset] if along is None else [dataset.isel({along: k}) for k in range(dataset.sizes[along])]
    crosses = np.zeros(len(x))  # per place; they are put below each other
    for k, line in enumerate(lines):
        look = look_of(str(line[along].values)) if along == "integrator" else style(k)
        label = None if along is None else _tick(line[along])
        error, unsure = line["error"].values, _unsure(line)
        ax.loglog(x, np.where(error > 0, error, np.nan), label=label, **look)
        ax.loglog(x[unsure], error[unsure], look["marker"], ms=4, mec=look["color"], mfc="white", zorder=3)
        diverged = line["status"].values == UNSTABLE
        height = 0.97 - 0.03 * crosses[diverged]
        ax.plot(x[diverged], height, "x", ms=5, color=look["color"], transform=ax.get_xaxis_transform())
        crosses += diverged
    scaled = dataset["error"].transpose(..., "dt").values / x**4 if by == "dt" and len(x) > 1 else np.zeros(0)
    if (scaled > 0).any():
        limits = ax.get_ylim()
        # Through the middle of the points, which neither rounding nor a runaway moves.
        ax.plot(x, np.median(scaled[scaled > 0]) * x**4, ":", color=BLACK, label="order 4", zorder=1)
        ax.set_ylim(limits)
    if _unsure(dataset).any():
        ax.plot([], [], "o", **HOLLOW)
    ax.set(xlabel=_title(dataset[by]), ylabel="largest error at the end [m]")
    if ax.get_legend_handles_labels()[0]:
        title = None if along is None else _title(dataset[along])
        # Beside the axes: inside, some line would always be under it.
        ax.legend(title=title, fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return ax


def stability(dataset: Any, y: str | None = None, ax: Any = None) -> Any:
    """Which members ran to their end, over the dimension `y` and dt, with the guaranteed stable time step as a line.

    Select a value of each further dimension first. Members below the line do not diverge, except from extreme states.
    """
    _require(dataset, "status", "dt")
    y = _other(dataset, y, [d for d in _long(dataset) if d != "dt"])
    if y is None:
        raise ValueError("y must be a dimension beside dt, this sweep has none")
    dataset = _reduced(dataset, "dt", y)
    (ax,) = shown_axes(ax)
    colors = needed("matplotlib.colors", "plot", "plot").ListedColormap([LIGHT_GREY, BLUE, RED, YELLOW])
    _mesh(dataset["status"], y, "dt", ax, cmap=colors, vmin=-0.5, vmax=3.5, edgecolors="w", linewidth=0.5)
    limit = dataset["max_stable_dt"].max("dt")  # NaN where a member has none
    known = np.isfinite(limit.values)
    limits = ax.get_ylim()
    ax.plot(_places(dataset[y])[known], limit.values[known], ".-", color=BLACK, label="guaranteed stable dt")
    ax.set_ylim(limits)
    for code in np.unique(dataset["status"]):
        ax.plot([], [], "s", color=colors(int(code)), label=STATUS[int(code)])
    ax.legend(fontsize="small", loc="lower left")
    return ax


def heatmap(dataset: Any, variable: str | None = None, x: str | None = None, y: str | None = None, ax: Any = None) -> Any:
    """A metric over the dimensions `x` and `y`: by default the first known of error, sag, penetration and stretch.

    For a sweep with one dimension, a line. Select a value of each further dimension first. Members that diverged are crossed
    out. An error below the error bound of the reference is a hollow circle. The colour scale is logarithmic if values
    span more than two decades.
    """
    variable = check.choice("variable", variable or _telling_metric(dataset), list(dataset.data_vars))
    free = [d for d in _long(dataset) if d not in (x, y)]
    x = x or (free.pop(0) if free else None)
    y = y or (free.pop(0) if free else None)
    if x is None:
        raise ValueError("heatmap needs a dimension that is longer than one, this sweep has none")
    if free:
        raise ValueError(
            f"a heat map has two dimensions, this sweep has {free} besides: select a value of "
            f"each, as in ds.isel({free[0]}=0)"
        )
    data = _reduced(dataset, x, y)
    unsure = _unsure(data) if variable == "error" else np.zeros(data[variable].shape, bool)
    (ax,) = shown_axes(ax)
    if y is None:
        places = _places(data[x])
        ax.plot(places, data[variable].values, "o-", ms=4)
        ax.plot(places[unsure], data[variable].values[unsure], "o", **HOLLOW)
        ax.set_ylabel(_title(data[variable], variable))
        _scale(ax, "x", data[x])
        return ax
    values = data[variable].where(~unsure)
    positive = values.values[np.isfinite(values.values)]
    mesh = _mesh(values, x, y, ax)
    if positive.size and positive.max() > 100 * positive.min() > 0:
        mesh.norm = "log"
    ax.figure.colorbar(mesh, ax=ax, label=_title(data[variable], variable))
    for which, marker, look in (
        (data["status"] == UNSTABLE, "x", {"color": RED, "ls": "none"}),
        (data["status"].copy(data=unsure), "o", HOLLOW),
    ):
        rows, columns = np.nonzero(which.transpose(y, x).values)
        ax.plot(_places(data[x])[columns], _places(data[y])[rows], marker, **look)
    if unsure.any():
        ax.legend(fontsize="small", loc="upper right", bbox_to_anchor=(1.0, -0.12), borderaxespad=0.0)
    return ax


def _mesh(values: Any, x: str, y: str, ax: Any, **options: Any) -> Any:
    """A cell for each member, on axes whose numbers are at their values."""
    ax.grid(False)
    scales = {f"{which}scale": "log" for which, d in (("x", x), ("y", y)) if _logarithmic(values[d])}
    mesh = values.plot.pcolormesh(x=x, y=y, ax=ax, add_colorbar=False, add_labels=False, **scales, **options)
    _scale(ax, "x", values[x])
    _scale(ax, "y", values[y])
    return mesh


def _unsure(dataset: Any) -> np.ndarray:
    """Where the error is below the error bound of its reference."""
    return np.asarray(dataset["error"].values < dataset["reference_error"].values)


def _grid_dimensions(dataset: Any) -> list[str]:
    return [str(d) for d in dataset["status"].dims]


def _long(dataset: Any) -> list[str]:
    """Dimensions of the grid with more than one value."""
    return [d for d in _grid_dimensions(dataset) if dataset.sizes[d] > 1]


def _reduced(dataset: Any, *kept: str | None) -> Any:
    """Without the other dimensions of the grid, and with rising numbers along those kept."""
    left = dataset.squeeze([d for d in _grid_dimensions(dataset) if d not in kept])
    return left.sortby([d for d in kept if d is not None and _numeric(left[d])])


def _require(dataset: Any, variable: str, dimension: str) -> None:
    if variable not in dataset:
        raise ValueError(f"this plot needs the metric {variable!r}; there are {list(dataset.data_vars)}")
    if dimension not in dataset.dims:
        raise ValueError(f"this plot needs a sweep over {dimension!r}, got {_grid_dimensions(dataset)}")


def _other(dataset: Any, chosen: str | None, others: list[str]) -> str | None:
    """The one dimension of `others`, or the chosen one if the rest has single values."""
    if chosen is not None:
        check.choice("dimension", chosen, _grid_dimensions(dataset))
    left = [d for d in others if d != chosen]
    if chosen is None and len(left) <= 1:
        return left[0] if left else None
    if left:
        raise ValueError(
            f"this plot has room for one dimension beside dt, this sweep has {others}: select a "
            f"value of the rest, as in ds.isel({left[-1]}=0)"
        )
    return chosen


def _telling_metric(dataset: Any) -> str:
    dims = dataset["status"].dims
    names = [str(n) for n, v in dataset.data_vars.items() if n not in RESERVED and v.dtype.kind == "f" and v.dims == dims]
    known = [name for name in names if np.isfinite(dataset[name]).any()]
    return next((name for name in (*TELLING, *names) if name in known), "status")


def _numeric(coordinate: Any) -> bool:
    return coordinate.dtype.kind in "iuf"


def _logarithmic(coordinate: Any) -> bool:
    values = coordinate.values
    return _numeric(coordinate) and values.min() > 0 and values.max() > 5 * values.min()


def _places(coordinate: Any) -> np.ndarray:
    """Positions of values on an axis: numbers at their value, labels one after the other."""
    return coordinate.values.astype(float) if _numeric(coordinate) else np.arange(float(coordinate.size))


def _scale(ax: Any, which: str, coordinate: Any) -> None:
    if not _numeric(coordinate):
        getattr(ax, f"set_{which}ticks")(np.arange(coordinate.size), [str(v) for v in coordinate.values])
    elif _logarithmic(coordinate):
        getattr(ax, f"set_{which}scale")("log")
    getattr(ax, f"set_{which}label")(_title(coordinate))


def _title(array: Any, name: str | None = None) -> str:
    text = (name or array.attrs.get("long_name") or str(array.name)).replace("_", " ")
    unit = array.attrs.get("units", "")
    return f"{text} [{unit}]" if unit and unit != "1" else text


def _tick(value: Any) -> str:
    return f"{float(value):.4g}" if _numeric(value) else str(value.values)
