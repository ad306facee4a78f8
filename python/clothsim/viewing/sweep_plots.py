"""Pictures of Datasets: of a sweep convergence fan, stability map and heat map; of `stability_map`; of `work_precision`.

Each function draws on the matplotlib axes `ax`, or on those of a new figure, and returns the axes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..accuracy.work_plot import draw_work_precision
from ..base import check
from ..base.extras import needed
from ..base.plots import BLACK, BLUE, GREY, LIGHT_GREY, RED, YELLOW, shown_axes, style
from ..stability.map import StabilityMap
from ..stability.map_report import draw_map
from ..sweeps.member import STATUS
from ..sweeps.metrics import RESERVED

KINDS = ("convergence", "stability", "heatmap")

_UNSTABLE = STATUS.index("unstable")
UNSURE = "below the\nreference's own"  # label of errors that the reference does not tell


def plot(dataset: Any, kind: str | None = None, **options: Any) -> Any:
    """Draw a sweep: `convergence`, `stability`, `heatmap` or the plot that suits it best. Other Datasets have one plot."""
    if "solver" in dataset.dims or "predicted" in dataset:
        if kind is not None:
            raise ValueError(f"kind must be None for a Dataset that is of no sweep, got {kind!r}")
        work = "solver" in dataset.dims
        return draw_work_precision(dataset, **options) if work else draw_map(StabilityMap.from_xarray(dataset), **options)
    if "status" not in dataset:
        raise ValueError("dataset must be of sweep, stability_map or work_precision, got one without their variables")
    draw: dict[str, Callable[..., Any]] = {"convergence": convergence, "stability": stability, "heatmap": heatmap}
    return draw[check.choice("kind", kind or suggested(dataset), KINDS)](dataset, **options)


def suggested(dataset: Any) -> str:
    """The plot that suits this sweep best."""
    if "error" in dataset and _steered_by(dataset):
        return "convergence"
    if "dt" in dataset.dims and len(_long(dataset)) > 1:
        return "stability"
    return "heatmap"


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
    others = [d for d in _long(dataset) if d != by]
    along = _other(dataset, along, others)
    dataset = dataset.squeeze([d for d in _grid_dimensions(dataset) if d not in (by, along)]).sortby(by)
    (ax,) = shown_axes(ax)
    x = dataset[by].values
    lines = [dataset] if along is None else [dataset.isel({along: k}) for k in range(dataset.sizes[along])]
    crosses = np.zeros(len(x))  # per place; they are put below each other
    hollow = False
    for k, line in enumerate(lines):
        style_of_line = style(k)
        color = style_of_line["color"]
        label = None if along is None else _tick(line[along])
        error = line["error"].values
        ax.loglog(x, np.where(error > 0, error, np.nan), label=label, **style_of_line)
        unsure = _unsure(line)
        ax.loglog(x[unsure], error[unsure], style_of_line["marker"], ms=4, mec=color, mfc="white", zorder=3)
        hollow |= bool(unsure.any())
        diverged = line["status"].values == _UNSTABLE
        height = 0.97 - 0.03 * crosses[diverged]
        ax.plot(x[diverged], height, "x", ms=5, color=color, transform=ax.get_xaxis_transform())
        crosses += diverged
    if by == "dt":
        _slope(ax, x, dataset["error"].transpose(..., "dt").values)
    if hollow:
        ax.plot([], [], "o", ms=4, mec=GREY, mfc="white", label=UNSURE)
    ax.set_xlabel(_title(dataset[by]))
    ax.set_ylabel("largest error at the end [m]")
    if ax.get_legend_handles_labels()[0]:
        title = None if along is None else _title(dataset[along])
        # Beside the axes: inside, some line would always be under it.
        ax.legend(title=title, fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return ax


def _slope(ax: Any, dt: np.ndarray, error: np.ndarray) -> None:
    good = np.isfinite(error) & (error > 0)
    if good.any() and len(dt) > 1:
        low, high = ax.get_ylim()
        # Through the middle of the points, which neither rounding nor a runaway moves.
        scale = np.median((error / dt**4)[good])
        ax.plot(dt, scale * dt**4, ":", color=BLACK, label="order 4", zorder=1)
        ax.set_ylim(low, high)


def stability(dataset: Any, y: str | None = None, ax: Any = None) -> Any:
    """Members that reached their end, over the dimension `y` and dt, with the guaranteed stable time step as a line.

    Select a value of each further dimension first. Members below the line do not diverge, except from extreme states.
    """
    _require(dataset, "status", "dt")
    y = _other(dataset, y, [d for d in _long(dataset) if d != "dt"])
    if y is None:
        raise ValueError("y must be a dimension beside dt, this sweep has none")
    dataset = dataset.squeeze([d for d in _grid_dimensions(dataset) if d not in ("dt", y)])
    status = dataset["status"].transpose("dt", y).values
    (ax,) = shown_axes(ax)
    ax.grid(False)
    colors = _pyplot().matplotlib.colors.ListedColormap([LIGHT_GREY, BLUE, RED, YELLOW])
    edges = _edges(dataset[y].values), _edges(dataset["dt"].values)
    ax.pcolormesh(*edges, status, cmap=colors, vmin=-0.5, vmax=3.5, edgecolors="w", linewidth=0.5)
    limit = dataset["max_stable_dt"].transpose("dt", y).values
    known = np.isfinite(limit).any(axis=0)
    line = np.nanmax(np.where(np.isfinite(limit), limit, -np.inf), axis=0)
    ax.plot(_places(dataset[y].values)[known], line[known], ".-", color=BLACK, label="guaranteed stable dt")
    for code in np.unique(status):
        ax.plot([], [], "s", color=colors(int(code)), label=STATUS[int(code)])
    _scale(ax, "x", dataset[y])
    _scale(ax, "y", dataset["dt"])
    ax.set_ylim(edges[1].min(), edges[1].max())
    ax.legend(fontsize="small", loc="lower left")
    return ax


def heatmap(
    dataset: Any,
    variable: str | None = None,
    x: str | None = None,
    y: str | None = None,
    ax: Any = None,
    cmap: Any = None,
    norm: Any = None,
) -> Any:
    """A metric (default: the first) over the dimensions `x` and `y`. For a sweep with one dimension, a line.

    Select a value of each further dimension first. Members that diverged are crossed out. An error below the error bound of
    the reference is a hollow circle without a colour. `cmap` and `norm` are those of matplotlib; by default colours are
    logarithmic where values span more than two decades.
    """
    variable = check.choice("variable", variable or _first_metric(dataset), list(dataset.data_vars))
    long = _long(dataset)
    free = [d for d in long if d not in (x, y)]
    x = x or (free.pop(0) if free else None)
    y = y or (free.pop(0) if free else None)
    if x is None:
        raise ValueError("heatmap needs a dimension that is longer than one, this sweep has none")
    if free:
        raise ValueError(
            f"a heat map has two dimensions, this sweep has {free} besides: select a value of "
            f"each, as in ds.isel({free[0]}=0)"
        )
    data = dataset.squeeze([d for d in _grid_dimensions(dataset) if d not in (x, y)])
    unsure = _unsure(data) if variable == "error" else np.zeros(data[variable].shape, bool)
    (ax,) = shown_axes(ax)
    hollow = {"ms": 4, "mec": GREY, "mfc": "white", "ls": "none", "zorder": 3, "label": UNSURE}
    if y is None:
        places = _places(data[x].values)
        ax.plot(places, data[variable].values, "o-", ms=4)
        ax.plot(places[unsure], data[variable].values[unsure], "o", **hollow)
        ax.set_ylabel(_title(data[variable], variable))
        _scale(ax, "x", data[x])
        return ax
    values = data[variable].where(~unsure).transpose(y, x).values.astype(float)
    positive = values[np.isfinite(values)]
    logarithmic = len(positive) and positive.min() > 0 and positive.max() > 100 * positive.min()
    ax.grid(False)
    if norm is None and logarithmic:
        norm = "log"
    mesh = ax.pcolormesh(_edges(data[x].values), _edges(data[y].values), values, norm=norm, cmap=cmap)
    ax.figure.colorbar(mesh, ax=ax, label=_title(data[variable], variable))
    for which, marker, look in (
        (data["status"] == _UNSTABLE, "x", {"color": RED, "ls": "none"}),
        (data["status"].copy(data=unsure), "o", hollow),
    ):
        rows, columns = np.nonzero(which.transpose(y, x).values)
        ax.plot(_places(data[x].values)[columns], _places(data[y].values)[rows], marker, **look)
    if unsure.any():
        ax.legend(fontsize="small", loc="upper right", bbox_to_anchor=(1.0, -0.12), borderaxespad=0.0)
    _scale(ax, "x", data[x])
    _scale(ax, "y", data[y])
    return ax


def _unsure(dataset: Any) -> np.ndarray:
    """Where the error is below the error bound of its reference."""
    return np.asarray(dataset["error"].values < dataset["reference_error"].values)


def _pyplot() -> Any:
    return needed("matplotlib.pyplot", "plot", extra="plot")


def _grid_dimensions(dataset: Any) -> list[str]:
    return [str(d) for d in dataset["status"].dims]


def _long(dataset: Any) -> list[str]:
    """Dimensions of the grid with more than one value."""
    return [d for d in _grid_dimensions(dataset) if dataset.sizes[d] > 1]


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


def _first_metric(dataset: Any) -> str:
    dims = dataset["status"].dims
    names = (str(n) for n, v in dataset.data_vars.items() if n not in RESERVED and v.dtype.kind == "f" and v.dims == dims)
    return next(names, "status")


def _logarithmic(values: np.ndarray) -> bool:
    return values.dtype.kind in "iuf" and values.min() > 0 and values.max() > 5 * values.min()


def _places(values: np.ndarray) -> np.ndarray:
    """Positions of values on an axis: numbers at their value, labels one after the other."""
    return values.astype(float) if values.dtype.kind in "iuf" else np.arange(float(len(values)))


def _edges(values: np.ndarray) -> np.ndarray:
    """Borders of the cells of a mesh, half-way between neighbours."""
    places = _places(values)
    logarithmic = _logarithmic(values)
    places = np.log(places) if logarithmic else places
    if len(places) == 1:
        edges = places[0] + np.array([-0.5, 0.5]) * (abs(places[0]) or 1.0) * 0.1
    else:
        middle = (places[1:] + places[:-1]) / 2
        edges = np.concatenate([[2 * places[0] - middle[0]], middle, [2 * places[-1] - middle[-1]]])
    return np.asarray(np.exp(edges) if logarithmic else edges)


def _scale(ax: Any, which: str, coordinate: Any) -> None:
    values = coordinate.values
    if values.dtype.kind not in "iuf":
        getattr(ax, f"set_{which}ticks")(np.arange(len(values)), [str(v) for v in values])
    elif _logarithmic(values):
        getattr(ax, f"set_{which}scale")("log")
    getattr(ax, f"set_{which}label")(_title(coordinate))


def _title(array: Any, name: str | None = None) -> str:
    text = (name or array.attrs.get("long_name") or str(array.name)).replace("_", " ")
    unit = array.attrs.get("units", "")
    return f"{text} [{unit}]" if unit and unit != "1" else text


def _tick(value: Any) -> str:
    return f"{float(value):.4g}" if value.dtype.kind in "iuf" else str(value.values)
