"""Plots of a sweep: the convergence fan, the map of outcomes and the heat map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...base import check
from ...base.extras import import_from_extra
from ...sweeps.member import STATUS
from ...sweeps.metrics import RESERVED
from .style import (
    BLACK,
    BLUE,
    GREY,
    HOLLOW,
    LIGHT_GREY,
    RED,
    YELLOW,
    axes_to_show,
    line_style,
    put_legend_beside,
    separate_ticks,
)
from .work_precision import style_of_method

KINDS = ("convergence", "stability", "heatmap")
UNSTABLE = STATUS.index("unstable")
OUTCOMES = (LIGHT_GREY, BLUE, RED, YELLOW)
"""Colours of the codes of "status"."""
TELLING = ("error", "sag", "penetration", "largest_stretch")
"""Metrics that a heat map shows first."""
UNSURE = "below the\nreference's own"
"""Label of errors that the reference does not tell."""
_UNSURE_LOOK = {**HOLLOW, "ms": 4, "mec": GREY, "label": UNSURE}
_MOST_LABELS = 10  # lines of numbers; more have a colour bar in place of a legend
_DECADES = 100.0  # largest over least value, from which on a scale is logarithmic


def draw_sweep(dataset: Any, kind: str | None = None, **options: Any) -> Any:
    """Draw a plot of one of the `KINDS`; by default the one that suits the sweep best."""
    draw: dict[str, Callable[..., Any]] = {
        "convergence": draw_error,
        "stability": draw_stability,
        "heatmap": draw_heatmap,
    }
    return draw[check.choice("kind", kind or suggest_kind(dataset), KINDS)](dataset, **options)


def suggest_kind(dataset: Any) -> str:
    """Return the kind of plot that suits this sweep best."""
    if "error" in dataset and _error_dimension(dataset):
        return "convergence"
    by_outcome = (
        "dt" in dataset.dims
        and len(_dimensions_with_several_values(dataset)) > 1
        and not {*TELLING[:3]} & {*dataset.data_vars}
    )
    return "stability" if by_outcome else "heatmap"


def _error_dimension(dataset: Any) -> str | None:
    """Return the dimension that controls the error."""
    return next((name for name in ("dt", "rtol", "atol") if name in dataset.dims), None)


def draw_error(dataset: Any, along: str | None = None, ax: Any = None) -> Any:
    """Draw the error over dt, rtol or atol, a line for each value of the dimension `along` (the
    convergence fan).

    Select a value of each further dimension first. Crosses at the top mark steps that diverged. The
    dotted line over dt is the slope of order 4. Hollow circles are errors below the error bound of
    the reference.
    """
    control = _error_dimension(dataset) or "dt"
    _require_variable_and_dimension(dataset, "error", control)
    along = _choose_other_dimension(
        dataset, along, [d for d in _dimensions_with_several_values(dataset) if d != control]
    )
    dataset = _reduce_to_dimensions(dataset, control, along)
    (ax,) = axes_to_show(ax)
    x = dataset[control].values
    lines = [dataset]
    if along is not None:
        lines = [dataset.isel({along: k}) for k in range(dataset.sizes[along])]
    is_fan = along is not None and len(lines) > _MOST_LABELS and _is_numeric(dataset[along])
    colors = _colors_of_values(dataset[along], ax) if is_fan else []
    crosses = np.zeros(len(x))  # number at each step; they are put below each other
    for k, line in enumerate(lines):
        look = style_of_method(str(line[along].values)) if along == "integrator" else line_style(k)
        label = None if along is None or is_fan else _tick_label(line[along])
        if is_fan:
            look = {"color": colors[k], "marker": "o", "ms": 3, "ls": "-"}
        error = line["error"].values
        unsure = _is_error_unsure(line)
        ax.loglog(x, np.where(error > 0, error, np.nan), label=label, **look)
        ax.loglog(x[unsure], error[unsure], **{**look, **HOLLOW})
        diverged = line["status"].values == UNSTABLE
        height = 0.97 - 0.03 * crosses[diverged]
        top = {"color": look["color"], "transform": ax.get_xaxis_transform()}
        ax.plot(x[diverged], height, "x", ms=5, **top)
        crosses += diverged
    if control == "dt" and len(x) > 1:
        scaled = dataset["error"].transpose(..., "dt").values / x**4
        if (scaled > 0).any():
            limits = ax.get_ylim()
            # The line goes through the middle of the points, which neither rounding nor a runaway
            # moves.
            middle = np.median(scaled[scaled > 0])
            ax.plot(x, middle * x**4, ":", color=BLACK, label="order 4", zorder=1)
            ax.set_ylim(limits)
    if _is_error_unsure(dataset).any():
        ax.plot([], [], "o", **_UNSURE_LOOK)
    ax.set(xlabel=_title_with_unit(dataset[control]), ylabel="largest error at the end [m]")
    if is_fan:
        ax.legend(fontsize="small", frameon=False)
    elif ax.get_legend_handles_labels()[0]:
        put_legend_beside(ax, None if along is None else _title_with_unit(dataset[along]))
    separate_ticks(ax)
    return ax


def _colors_of_values(coordinate: Any, ax: Any) -> Any:
    """Return a colour of each value of a coordinate, and draw their colour bar."""
    colors = import_from_extra("matplotlib.colors", "plot", "plot")
    cm = import_from_extra("matplotlib.cm", "plot", "plot")
    scale = colors.LogNorm if _is_logarithmic(coordinate) else colors.Normalize
    values = coordinate.values.astype(float)
    mappable = cm.ScalarMappable(scale(values.min(), values.max()), "viridis")
    ax.figure.colorbar(mappable, ax=ax, label=_title_with_unit(coordinate))
    return mappable.to_rgba(values)


def draw_stability(dataset: Any, y: str | None = None, ax: Any = None) -> Any:
    """Draw which members ran to their end, over the dimension `y` and dt, with the guaranteed
    stable time step as a line.

    Select a value of each further dimension first. Members below the line do not diverge, except
    from extreme states.
    """
    _require_variable_and_dimension(dataset, "status", "dt")
    y = _choose_other_dimension(
        dataset, y, [d for d in _dimensions_with_several_values(dataset) if d != "dt"]
    )
    if y is None:
        raise ValueError("y must be a dimension beside dt, this sweep has none")
    dataset = _reduce_to_dimensions(dataset, "dt", y)
    (ax,) = axes_to_show(ax)
    _draw_outcomes(dataset["status"], y, "dt", ax)
    limit = dataset["max_stable_dt"].max("dt")  # NaN where a member has none
    finite = np.isfinite(limit.values)
    limits = ax.get_ylim()
    places = _axis_positions(dataset[y])[finite]
    label = "guaranteed\nstable dt"
    ax.plot(places, limit.values[finite], ".-", color=BLACK, label=label)
    ax.set_ylim(limits)
    put_legend_beside(ax)
    separate_ticks(ax)
    return ax


def _draw_outcomes(status: Any, x: str, y: str, ax: Any) -> None:
    """Draw the outcome of each member, with labels of those that occur."""
    colors = import_from_extra("matplotlib.colors", "plot", "plot").ListedColormap(OUTCOMES)
    _draw_cells(status, x, y, ax, cmap=colors, vmin=-0.5, vmax=3.5, edgecolors="w", linewidth=0.5)
    for code in np.unique(status):
        ax.plot([], [], "s", color=OUTCOMES[int(code)], label=STATUS[int(code)])


def draw_heatmap(
    dataset: Any,
    variable: str | None = None,
    x: str | None = None,
    y: str | None = None,
    ax: Any = None,
) -> Any:
    """Draw a metric over the dimensions `x` and `y`: by default the first that has values of error,
    sag, penetration and stretch.

    For a sweep with one dimension, draw a line. Select a value of each further dimension first.
    Members that diverged are crossed out. An error below the error bound of the reference is a
    hollow circle. The scale of values is logarithmic if they span more than two decades.
    """
    variable = check.choice(
        "variable", variable or _telling_metric(dataset), list(dataset.data_vars)
    )
    free = [d for d in _dimensions_with_several_values(dataset) if d not in (x, y)]
    x = x or (free.pop(0) if free else None)
    y = y or (free.pop(0) if free else None)
    if x is None:
        raise ValueError("heatmap needs a dimension that is longer than one, this sweep has none")
    if free:
        raise ValueError(
            f"a heat map has two dimensions, this sweep has {free} besides: select a value of "
            f"each, as in ds.isel({free[0]}=0)"
        )
    data = _reduce_to_dimensions(dataset, x, y)
    (ax,) = axes_to_show(ax)
    if y is None:
        _draw_line(data, variable, x, ax)
    elif variable == "status":
        _draw_outcomes(data["status"], x, y, ax)
        put_legend_beside(ax)
    else:
        _draw_color_map(data, variable, x, y, ax)
    separate_ticks(ax)
    return ax


def _draw_line(data: Any, variable: str, x: str, ax: Any) -> None:
    """Draw a metric of a sweep over one dimension."""
    values, title = _values_and_title(data[variable])
    places = _axis_positions(data[x])
    unsure = _is_variable_unsure(data, variable)
    diverged = data["status"].values == UNSTABLE
    dash = "-" if _is_numeric(data[x]) and x != "sample" else "none"
    ax.plot(places, values, marker="o", ls=dash, color=BLUE, ms=4)
    ax.plot(places[unsure], values.values[unsure], "o", **_UNSURE_LOOK)
    top = {"color": RED, "transform": ax.get_xaxis_transform(), "label": "unstable"}
    ax.plot(places[diverged], np.full(int(diverged.sum()), 0.97), "x", **top)
    if unsure.any() or diverged.any():
        put_legend_beside(ax)
    if _spans_decades(values):
        ax.set_yscale("log")
    ax.set_ylabel(title)
    _set_up_axis(ax, "x", data[x])


def _draw_color_map(data: Any, variable: str, x: str, y: str, ax: Any) -> None:
    """Draw a metric of a sweep over two dimensions as colours."""
    values, title = _values_and_title(data[variable])
    unsure = _is_variable_unsure(data, variable)
    mesh = _draw_cells(values.where(~unsure), x, y, ax)
    if _spans_decades(values.where(~unsure)):
        mesh.norm = "log"
    ax.figure.colorbar(mesh, ax=ax, label=title)
    diverged = data["status"] == UNSTABLE
    for members, marker, look in (
        (diverged, "x", {"color": RED, "ls": "none", "label": "unstable"}),
        (data["status"].copy(data=unsure), "o", _UNSURE_LOOK),
    ):
        rows, columns = np.nonzero(members.transpose(y, x).values)
        if rows.size:
            ax.plot(
                _axis_positions(data[x])[columns], _axis_positions(data[y])[rows], marker, **look
            )
    if unsure.any() or diverged.any():
        ax.legend(
            fontsize="small",
            ncols=2,
            frameon=False,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.0,
        )


def _values_and_title(array: Any) -> tuple[Any, str]:
    """Return the values of a metric as they are drawn, ratios in percent, and their title."""
    if array.attrs.get("units") == "1":
        return 100.0 * array, f"{str(array.name).replace('_', ' ')} [%]"
    return array, _title_with_unit(array, str(array.name))


def _spans_decades(values: Any) -> bool:
    """Return whether finite values, all positive, span more than two decades."""
    finite = values.values[np.isfinite(values.values)]
    return bool(finite.size and finite.max() > _DECADES * finite.min() > 0)


def _draw_cells(values: Any, x: str, y: str, ax: Any, **options: Any) -> Any:
    """Draw a cell for each member, on axes whose numbers are at their values."""
    ax.grid(False)
    numbers = np.ma.masked_invalid(values.transpose(y, x).values.astype(float))
    mesh = ax.pcolormesh(_cell_edges(values[x]), _cell_edges(values[y]), numbers, **options)
    _set_up_axis(ax, "x", values[x])
    _set_up_axis(ax, "y", values[y])
    return mesh


def _cell_edges(coordinate: Any) -> np.ndarray:
    """Return the edges of the cells around the places of a coordinate."""
    places = _axis_positions(coordinate)
    if _is_logarithmic(coordinate):
        places = np.log(places)
    middles = (places[1:] + places[:-1]) / 2
    first = 2 * places[0] - middles[0]
    last = 2 * places[-1] - middles[-1]
    edges = np.concatenate([[first], middles, [last]])
    return np.exp(edges) if _is_logarithmic(coordinate) else edges


def _is_error_unsure(dataset: Any) -> np.ndarray:
    """Return where the error is below the error bound of its reference."""
    return np.asarray(dataset["error"].values < dataset["reference_error"].values)


def _is_variable_unsure(data: Any, variable: str) -> np.ndarray:
    """Return where the variable is an error that its reference does not tell."""
    if variable == "error":
        return _is_error_unsure(data)
    return np.zeros(data[variable].shape, bool)


def _grid_dimensions(dataset: Any) -> list[str]:
    return [str(d) for d in dataset["status"].dims]


def _dimensions_with_several_values(dataset: Any) -> list[str]:
    """Return the dimensions of the grid with more than one value."""
    return [d for d in _grid_dimensions(dataset) if dataset.sizes[d] > 1]


def _reduce_to_dimensions(dataset: Any, *dimensions: str | None) -> Any:
    """Return the Dataset over these dimensions of the grid alone, in rising order."""
    reduced = dataset.squeeze([d for d in _grid_dimensions(dataset) if d not in dimensions])
    return reduced.sortby([d for d in dimensions if d is not None and _is_numeric(reduced[d])])


def _require_variable_and_dimension(dataset: Any, variable: str, dimension: str) -> None:
    if variable not in dataset:
        raise ValueError(
            f"this plot needs the metric {variable!r}; there are {list(dataset.data_vars)}"
        )
    if dimension not in dataset.dims:
        raise ValueError(
            f"this plot needs a sweep over {dimension!r}, got {_grid_dimensions(dataset)}"
        )


def _choose_other_dimension(dataset: Any, chosen: str | None, others: list[str]) -> str | None:
    """Return the one dimension of `others`, or the chosen one if the rest has single values."""
    if chosen is not None:
        check.choice("dimension", chosen, _grid_dimensions(dataset))
    rest = [d for d in others if d != chosen]
    if chosen is None and len(rest) <= 1:
        return rest[0] if rest else None
    if rest:
        raise ValueError(
            f"this plot has room for one dimension beside dt, this sweep has {others}: select a "
            f"value of the rest, as in ds.isel({rest[-1]}=0)"
        )
    return chosen


def _telling_metric(dataset: Any) -> str:
    """Return the metric that a heat map shows by default; "status" where none has a value."""
    dims = dataset["status"].dims
    names = [
        str(n)
        for n, v in dataset.data_vars.items()
        if n not in RESERVED and v.dtype.kind == "f" and v.dims == dims
    ]
    finite = [name for name in names if np.isfinite(dataset[name]).any()]
    return next((name for name in (*TELLING, *names) if name in finite), "status")


def _is_numeric(coordinate: Any) -> bool:
    return coordinate.dtype.kind in "iuf"


def _is_logarithmic(coordinate: Any) -> bool:
    values = coordinate.values
    return _is_numeric(coordinate) and values.min() > 0 and values.max() > 5 * values.min()


def _axis_positions(coordinate: Any) -> np.ndarray:
    """Return positions of values on an axis: numbers at their value, labels one after the other."""
    if _is_numeric(coordinate):
        return np.asarray(coordinate.values.astype(float))
    return np.arange(float(coordinate.size))


def _set_up_axis(ax: Any, side: str, coordinate: Any) -> None:
    """Give the axis "x" or "y" the title, the scale and the labels of a coordinate."""
    if not _is_numeric(coordinate):
        labels = [str(value) for value in coordinate.values]
        getattr(ax, f"set_{side}ticks")(np.arange(coordinate.size), labels)
    elif _is_logarithmic(coordinate):
        getattr(ax, f"set_{side}scale")("log")
    getattr(ax, f"set_{side}label")(_title_with_unit(coordinate))


def _title_with_unit(array: Any, name: str | None = None) -> str:
    """Return the name of an array, or `name`, with its unit."""
    text = (name or array.attrs.get("long_name") or str(array.name)).replace("_", " ")
    unit = array.attrs.get("units", "")
    return f"{text} [{unit}]" if unit and unit != "1" else text


def _tick_label(value: Any) -> str:
    return f"{float(value):.4g}" if _is_numeric(value) else str(value.values)
