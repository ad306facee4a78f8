"""Plots by matplotlib: curves of a run, and pictures of Datasets of `sweep`, `stability_map` and
`work_precision`.

Each function for a Dataset draws on the matplotlib axes `ax`, or on those of a new figure, and
returns the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..accuracy.work import OWN, Convergence
from ..base import Floats, check
from ..base.extras import needed
from ..base.files import replacing
from ..methods.integrators import METHODS
from ..model.scene import Scene
from ..sweeps.member import STATUS
from ..sweeps.metrics import RESERVED
from .picture import file_path

if TYPE_CHECKING:
    from ..accuracy.fit import Fit

# Okabe and Ito's palette: readers with any colour vision tell these colours apart. The least Lab
# distance of two of them is 16 in simulations of the three deficiencies, and grey would have 9 to
# pink and green.
BLACK, BLUE, GREEN, RED, YELLOW = "#000000", "#0072B2", "#009E73", "#D55E00", "#F0E442"
COLORS = (BLUE, RED, GREEN, BLACK, "#CC79A7", "#E69F00", "#56B4E9", YELLOW)
GREY, LIGHT_GREY = "0.5", "0.85"

# Of lengths without a common factor to the colours: a further round of colours has other markers.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
DASHES = ("-", "--", ":", "-.", (0, (7, 2, 1, 2, 1, 2)))

DPI = 120
"""Pixels per inch of a picture file."""

_DASHES = {
    ("dt", "double"): "-",
    ("dt", "single"): ":",
    ("rtol", "double"): "-.",
    ("rtol", "single"): (0, (7, 2, 1, 2)),
}
_HOLLOW = {"mfc": "white", "ls": "none", "zorder": 3}

# A mass point touches a sphere if it is closer than the contact radius and this part of the
# spacing. Half of it misses points that bounce while they rest, twice of it counts points that only
# pass.
TOUCH = 1 / 32


def style(k: int) -> dict[str, Any]:
    """Colour, marker and dash of the line number `k` of a figure; lines of one colour differ in
    marker and dash.
    """
    return {
        "color": COLORS[k % len(COLORS)],
        "marker": MARKERS[k % len(MARKERS)],
        "ls": DASHES[k % len(DASHES)],
        "ms": 4,
    }


def shown_axes(
    ax: Any = None, columns: int = 1, width: float = 6.4, height: float = 4.6, **options: Any
) -> list[Any]:
    """The `columns` axes that a caller gave, or those of a new figure that pyplot shows."""
    given = [] if ax is None else list(np.ravel(ax))
    if not given:
        pyplot = needed("matplotlib.pyplot", "plot", "plot")
        given = list(
            np.ravel(
                pyplot.subplots(
                    1, columns, figsize=(width, height), layout="constrained", **options
                )[1]
            )
        )
        for one in given:
            tidy(one)
    if len(given) != columns or not all(hasattr(one, "plot") for one in given):
        raise ValueError(f"ax must be None or axes of matplotlib, {columns} of them, got {ax!r}")
    return given


# From an end of a line [points] to its label, and which side of the text is there; the first that
# is free is taken.
PLACES = [
    (7, 0),
    (7, -9),
    (7, 9),
    (0, -12),
    (0, 12),
    (-7, -9),
    (-7, 9),
    (-7, 0),
    (12, -20),
    (12, 20),
    (-12, -20),
    (-12, 20),
]


def label_lines(axes: Any) -> None:
    """Label each line at a point, if possible an end, without overlap with lines or labels."""
    axes.figure.draw_without_rendering()  # lays out the axes
    paths = [
        line.get_transform().transform(line.get_xydata())
        for line in axes.lines
        if len(line.get_xydata())
    ]
    ink = np.concatenate(
        [np.linspace(a, b, 60) for path in paths for a, b in zip(path, [*path[1:], path[-1]])]
    )
    taken = np.empty((0, 2, 2))  # lower left and upper right corners of labels [pixels]
    for line in axes.lines:
        points = line.get_xydata()[np.isfinite(line.get_xydata()).all(axis=1)]
        if line.get_label().startswith("_") or not len(points):
            continue
        look = {
            "textcoords": "offset points",
            "fontsize": "small",
            "color": line.get_color(),
            "va": "center",
        }
        text = axes.annotate(line.get_label(), points[-1], PLACES[0], annotation_clip=False, **look)
        size, pixels = text.get_window_extent().size, axes.transData.transform(points)
        from_ends = sorted(range(len(points)), key=lambda k: min(k + 0.5, len(points) - 1 - k))
        for k, (dx, dy) in product(from_ends, PLACES):
            low = (
                pixels[k]
                + np.multiply((dx, dy), axes.figure.dpi / 72)
                - size * (0.5 - 0.5 * np.sign(dx), 0.5)
            )
            crossed = ((ink > low - 2) & (ink < low + size + 2)).all(axis=1).any()
            crossed |= ((taken[:, 0] < low + size) & (taken[:, 1] > low)).all(axis=1).any()
            if not crossed and axes.bbox.count_contains([low, low + size]) == 2:
                break
        text.xy, text.xyann = points[k], (dx, dy)
        text.set_ha(("right", "center", "left")[np.sign(dx) + 1])
        taken = np.concatenate([taken, [[low, low + size]]])


def tidy(axes: Any) -> None:
    """A thin grid, and no frame at the top and at the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)


def touching(scene: Scene, x: Floats, t: float) -> int:
    """Return the number of mass points that touch a sphere or are in its layer at the time `t`."""
    touched = np.zeros(scene.cloth.shape, bool)
    for sphere in scene.spheres:
        near = TOUCH * max(scene.cloth.spacing)
        if sphere.response == "penalty":
            near = sphere.layer(scene.cloth)["thickness"]
        touched |= sphere.height(x, t) <= sphere.offset_length(scene.cloth) + near
    return int(touched.sum())


def curves(run: Any) -> dict[str, Floats]:
    """Each curve, shape (frames,).

    "kinetic", "elastic", "gravity", "force" and "total" [J]; "stretch" of the most stretched
    spring, l/L - 1; "points" and "triangles", the deepest of each below the true radius of any
    sphere [m]; "contacts", the number of mass points that touch a sphere. Without a sphere the last
    three are missing.
    """
    found: dict[str, Floats] = {**run.energy(), "stretch": run.stretch()["largest"]}
    if run.scene.spheres:
        found |= run.penetration()
        found["contacts"] = np.array(
            [touching(run.scene, x, float(t)) for x, t in zip(run.x, run.t)], float
        )
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
        raise ValueError(
            f"path must end in one of {', '.join(f'.{name}' for name in formats)}, got "
            f"{str(path)!r}"
        )

    class Plot(base):  # type: ignore[misc, valid-type]
        """A figure that a notebook shows without a choice of a backend."""

        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, dpi=DPI)
            return file.getvalue()

    found = curves(run)
    panels = [panel for panel in PANELS if panel[2][0] in found]
    drawn = Plot(figsize=(8, 0.8 + 1.6 * len(panels)), layout="constrained")
    axes = drawn.subplots(len(panels), squeeze=False, sharex=True)
    few: dict[str, Any] = {"marker": "o", "ms": 3} if len(run.t) < 20 else {}
    for axis, (label, scale, names) in zip(axes[:, 0], panels, strict=True):
        tidy(axis)
        for name in names:
            color, dash, width = STYLES.get(name, (BLACK, "-", 1.5))
            look = {"label": LABELS.get(name, name), "color": color, "ls": dash, "lw": width, **few}
            axis.plot(run.t, scale * found[name], clip_on=False, **look)
        axis.set(ylabel=label, xmargin=0)
        if not any((found[name] < 0).any() for name in names):
            axis.set_ylim(bottom=0)
        if len(names) > 1:
            axis.legend(
                fontsize="small",
                frameon=False,
                loc="upper left",
                bbox_to_anchor=(1.01, 1.0),
                borderaxespad=0.0,
            )
    axes[-1, 0].set_xlabel("time [s]")
    drawn.align_ylabels()
    if path is not None:
        with replacing(path) as part:
            drawn.savefig(part, dpi=DPI)
    return drawn


KINDS = ("convergence", "stability", "heatmap")
UNSTABLE = STATUS.index("unstable")
TELLING = ("error", "sag", "penetration", "largest_stretch")  # metrics that a heat map shows first
UNSURE = "below the\nreference's own"  # label of errors that the reference does not tell
HOLLOW = {**_HOLLOW, "ms": 4, "mec": GREY, "label": UNSURE}


def plot(dataset: Any, kind: str | None = None, **options: Any) -> Any:
    """Draw a sweep: `convergence`, `stability`, `heatmap` or the plot that suits it best. Other
    Datasets have one plot.
    """
    if "solver" in dataset.dims or "predicted" in dataset:
        if kind is not None:
            raise ValueError(f"kind must be None for a Dataset that is of no sweep, got {kind!r}")
        return (draw_work_precision if "solver" in dataset.dims else draw_map)(dataset, **options)
    if "status" not in dataset:
        raise ValueError(
            "dataset must be of sweep, stability_map or work_precision, got one without "
            "their variables"
        )
    draw: dict[str, Callable[..., Any]] = {
        "convergence": convergence,
        "stability": stability,
        "heatmap": heatmap,
    }
    return draw[check.choice("kind", kind or suggested(dataset), KINDS)](dataset, **options)


def suggested(dataset: Any) -> str:
    """The plot that suits this sweep best."""
    if "error" in dataset and _steered_by(dataset):
        return "convergence"
    by_outcome = (
        "dt" in dataset.dims
        and len(_long(dataset)) > 1
        and not {*TELLING[:3]} & {*dataset.data_vars}
    )
    return "stability" if by_outcome else "heatmap"


def _steered_by(dataset: Any) -> str | None:
    """The dimension that controls the error."""
    return next((name for name in ("dt", "rtol", "atol") if name in dataset.dims), None)


def convergence(dataset: Any, along: str | None = None, ax: Any = None) -> Any:
    """Error over dt, rtol or atol, a line for each value of the dimension `along` (the convergence
    fan).

    Select a value of each further dimension first. Crosses at the top mark steps that diverged. The
    dotted line over dt is the slope of order 4. Hollow circles are errors below the error bound of
    the reference.
    """
    by = _steered_by(dataset) or "dt"
    _require(dataset, "error", by)
    along = _other(dataset, along, [d for d in _long(dataset) if d != by])
    dataset = _reduced(dataset, by, along)
    (ax,) = shown_axes(ax)
    x = dataset[by].values
    lines = (
        [dataset]
        if along is None
        else [dataset.isel({along: k}) for k in range(dataset.sizes[along])]
    )
    crosses = np.zeros(len(x))  # per place; they are put below each other
    for k, line in enumerate(lines):
        look = look_of(str(line[along].values)) if along == "integrator" else style(k)
        label = None if along is None else _tick(line[along])
        error, unsure = line["error"].values, _unsure(line)
        ax.loglog(x, np.where(error > 0, error, np.nan), label=label, **look)
        ax.loglog(x[unsure], error[unsure], **{**look, **_HOLLOW})
        diverged = line["status"].values == UNSTABLE
        height = 0.97 - 0.03 * crosses[diverged]
        ax.plot(
            x[diverged], height, "x", ms=5, color=look["color"], transform=ax.get_xaxis_transform()
        )
        crosses += diverged
    scaled = (
        dataset["error"].transpose(..., "dt").values / x**4
        if by == "dt" and len(x) > 1
        else np.zeros(0)
    )
    if (scaled > 0).any():
        limits = ax.get_ylim()
        # Through the middle of the points, which neither rounding nor a runaway moves.
        ax.plot(
            x, np.median(scaled[scaled > 0]) * x**4, ":", color=BLACK, label="order 4", zorder=1
        )
        ax.set_ylim(limits)
    if _unsure(dataset).any():
        ax.plot([], [], "o", **HOLLOW)
    ax.set(xlabel=_title(dataset[by]), ylabel="largest error at the end [m]")
    if ax.get_legend_handles_labels()[0]:
        title = None if along is None else _title(dataset[along])
        # Beside the axes: inside, some line would always be under it.
        ax.legend(
            title=title,
            fontsize="small",
            loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
            borderaxespad=0.0,
        )
    return ax


def stability(dataset: Any, y: str | None = None, ax: Any = None) -> Any:
    """Which members ran to their end, over the dimension `y` and dt, with the guaranteed stable
    time step as a line.

    Select a value of each further dimension first. Members below the line do not diverge, except
    from extreme states.
    """
    _require(dataset, "status", "dt")
    y = _other(dataset, y, [d for d in _long(dataset) if d != "dt"])
    if y is None:
        raise ValueError("y must be a dimension beside dt, this sweep has none")
    dataset = _reduced(dataset, "dt", y)
    (ax,) = shown_axes(ax)
    colors = needed("matplotlib.colors", "plot", "plot").ListedColormap(
        [LIGHT_GREY, BLUE, RED, YELLOW]
    )
    _mesh(
        dataset["status"],
        y,
        "dt",
        ax,
        cmap=colors,
        vmin=-0.5,
        vmax=3.5,
        edgecolors="w",
        linewidth=0.5,
    )
    limit = dataset["max_stable_dt"].max("dt")  # NaN where a member has none
    known = np.isfinite(limit.values)
    limits = ax.get_ylim()
    ax.plot(
        _places(dataset[y])[known],
        limit.values[known],
        ".-",
        color=BLACK,
        label="guaranteed stable dt",
    )
    ax.set_ylim(limits)
    for code in np.unique(dataset["status"]):
        ax.plot([], [], "s", color=colors(int(code)), label=STATUS[int(code)])
    ax.legend(fontsize="small", loc="lower left")
    return ax


def heatmap(
    dataset: Any,
    variable: str | None = None,
    x: str | None = None,
    y: str | None = None,
    ax: Any = None,
) -> Any:
    """A metric over the dimensions `x` and `y`: by default the first known of error, sag,
    penetration and stretch.

    For a sweep with one dimension, a line. Select a value of each further dimension first. Members
    that diverged are crossed out. An error below the error bound of the reference is a hollow
    circle. The colour scale is logarithmic if values span more than two decades.
    """
    variable = check.choice(
        "variable", variable or _telling_metric(dataset), list(dataset.data_vars)
    )
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
        ax.legend(
            fontsize="small", loc="upper right", bbox_to_anchor=(1.0, -0.12), borderaxespad=0.0
        )
    return ax


def _mesh(values: Any, x: str, y: str, ax: Any, **options: Any) -> Any:
    """A cell for each member, on axes whose numbers are at their values."""
    ax.grid(False)
    scales = {
        f"{which}scale": "log" for which, d in (("x", x), ("y", y)) if _logarithmic(values[d])
    }
    mesh = values.plot.pcolormesh(
        x=x, y=y, ax=ax, add_colorbar=False, add_labels=False, **scales, **options
    )
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
        raise ValueError(
            f"this plot needs the metric {variable!r}; there are {list(dataset.data_vars)}"
        )
    if dimension not in dataset.dims:
        raise ValueError(
            f"this plot needs a sweep over {dimension!r}, got {_grid_dimensions(dataset)}"
        )


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
    names = [
        str(n)
        for n, v in dataset.data_vars.items()
        if n not in RESERVED and v.dtype.kind == "f" and v.dims == dims
    ]
    known = [name for name in names if np.isfinite(dataset[name]).any()]
    return next((name for name in (*TELLING, *names) if name in known), "status")


def _numeric(coordinate: Any) -> bool:
    return coordinate.dtype.kind in "iuf"


def _logarithmic(coordinate: Any) -> bool:
    values = coordinate.values
    return _numeric(coordinate) and values.min() > 0 and values.max() > 5 * values.min()


def _places(coordinate: Any) -> np.ndarray:
    """Positions of values on an axis: numbers at their value, labels one after the other."""
    return (
        coordinate.values.astype(float)
        if _numeric(coordinate)
        else np.arange(float(coordinate.size))
    )


def _scale(ax: Any, which: str, coordinate: Any) -> None:
    if not _numeric(coordinate):
        getattr(ax, f"set_{which}ticks")(
            np.arange(coordinate.size), [str(v) for v in coordinate.values]
        )
    elif _logarithmic(coordinate):
        getattr(ax, f"set_{which}scale")("log")
    getattr(ax, f"set_{which}label")(_title(coordinate))


def _title(array: Any, name: str | None = None) -> str:
    text = (name or array.attrs.get("long_name") or str(array.name)).replace("_", " ")
    unit = array.attrs.get("units", "")
    return f"{text} [{unit}]" if unit and unit != "1" else text


def _tick(value: Any) -> str:
    return f"{float(value):.4g}" if _numeric(value) else str(value.values)


def look_of(method: str, others: Sequence[str] = ()) -> dict[str, Any]:
    """Colour and marker of a method, the same in every plot; others' methods follow our own."""
    names = [*METHODS, *others, method]
    return {**style(names.index(method)), "ls": "-", "lw": 1.2}


def draw_work_precision(data: Any, ax: Any = None) -> Any:
    """Draw error against wall time, and against force evaluations, on two matplotlib axes, given or
    new.

    With one given axes, draw only against wall time. Each method has the same colour and marker in
    every plot. Methods at tolerances are dash-dotted, "single" has more dots, other libraries are
    dashed. Points below the error of the reference are hollow.
    """
    panels = shown_axes(ax, 1 if np.size(ax) == 1 and ax is not None else 2, 13.0, 6.4, sharey=True)
    precisions = set(data["precision"].values[data["library"].values == OWN])
    methods = [str(name).removesuffix(" adaptive") for name in data["integrator"].values]
    others = list(dict.fromkeys(name for name in methods if name not in METHODS))
    floor = data.attrs["reference_error_estimate_rms"]
    for m, label in enumerate(map(str, data["solver"].values)):
        one, look = data.isel(solver=m), look_of(methods[m], others)
        kind = str(one["control"].values), str(one["precision"].values)
        look["ls"] = _DASHES[kind] if str(one["library"].values) == OWN else "--"
        if len(precisions) == 1:
            label = label.removesuffix(f" {next(iter(precisions))}")
        rms = np.where(np.isfinite(one["rms_error"]), one["rms_error"], np.nan)
        if np.isfinite(rms).any():
            for panel, cost in zip(panels, ("wall_time", "force_evaluations")):
                panel.plot(one[cost], rms, label=label, **look)
                panel.plot(one[cost][rms < floor], rms[rms < floor], **{**look, **_HOLLOW})
    front = data["pareto"].values
    order = np.argsort(data["wall_time"].values[front])
    times, errors = (data[name].values[front][order] for name in ("wall_time", "rms_error"))
    wide = {"color": BLACK, "lw": 5, "alpha": 0.15, "marker": "o", "ms": 11, "zorder": 0}
    panels[0].plot(times, errors, drawstyle="steps-post", **wide)
    texts = (
        f"wall time per simulated second [s/s]{'; grey: front' if front.any() else ''}",
        "force evaluations",
    )
    for panel, text in zip(panels, texts):
        panel.set(xscale="log", yscale="log", xlabel=text)
        if floor > 0:
            panel.axhline(floor, color=GREY, lw=0.8)
            # At the left: where a method is fast, its error is not yet that small.
            where = {"xycoords": ("axes fraction", "data"), "va": "bottom", "fontsize": 8}
            panel.annotate("error of the reference", (0.01, floor), color=GREY, **where)
        low, high = panel.get_xlim()
        panel.set_xlim(low, high * (high / low) ** 0.3)  # room for labels
    panels[0].set_ylabel(f"rms error after {data.attrs['duration']:g} s [m]")
    for panel in panels:
        label_lines(panel)
    return np.array(panels)


def draw_convergence(found: Convergence, ax: Any = None) -> Any:
    """`Convergence.plot`."""
    (axes,) = shown_axes(ax)
    look = look_of(found.integrator)
    good = np.isfinite(found.rms) & (found.rms > 0)
    axes.loglog(
        found.dt[good], found.rms[good], label=f"{found.integrator}, {found.precision}", **look
    )
    outside = good & ~found.fitted
    axes.loglog(found.dt[outside], found.rms[outside], label="not fitted", **{**look, **_HOLLOW})
    if found.fitted.sum() > 1:
        dt, middle = (
            found.dt[found.fitted],
            np.log(found.rms[found.fitted] / found.dt[found.fitted] ** found.order).mean(),
        )
        axes.loglog(
            dt,
            np.exp(middle) * dt**found.order,
            color=BLACK,
            ls="--",
            label=f"order {found.order:.2f}",
            zorder=1,
        )
    axes.loglog(
        found.dt, found.floor, color=BLACK, ls=":", label="floor of the comparison", zorder=1
    )
    unstable = found.dt[np.isinf(found.rms)]
    if unstable.size:
        top = axes.get_xaxis_transform()
        axes.plot(
            unstable,
            np.full(unstable.size, 0.97),
            "x",
            color=look["color"],
            transform=top,
            label="unstable",
        )
    axes.set(xlabel="time step dt [s]", ylabel=f"rms error after {found.reference.t[-1]:g} s [m]")
    axes.legend(fontsize="small", frameon=False)
    return axes


def draw_fit(found: Fit, ax: Any = None) -> Any:
    """`Fit.plot`."""
    curves, off, matrix = shown_axes(ax, 3, 13.0, 4.2)
    data = found.positions.reshape(len(found.times), -1, 3)
    residuals = found.residuals.reshape(data.shape)
    spread = np.nan_to_num(np.nanmax(data, axis=0) - np.nanmin(data, axis=0))
    for n, k in enumerate(np.argsort(-spread.max(axis=1), kind="stable")[:3]):
        c, place = (
            int(spread[k].argmax()),
            tuple(map(int, np.unravel_index(k, found.positions.shape[1:-1]))),
        )
        label = f"{'xyz'[c]} of point {place if len(place) > 1 else f'number {k}'}"
        curves.plot(found.times, data[:, k, c], "o", ms=4, color=COLORS[n], label=label)
        curves.plot(found.times, data[:, k, c] - residuals[:, k, c], "-", color=COLORS[n])
    curves.set(xlabel="time [s]", ylabel="position [m]", title="measured (dots) and fitted")
    curves.legend(fontsize="small")
    off.plot(
        found.times, residuals.reshape(len(found.times), -1) * 1e3, ".", ms=3, color=BLUE, alpha=0.5
    )
    for side in (-1, 1):
        off.axhline(side * 2e3 * found.report["sigma"], color=GREY, ls="--")
    off.set(
        xlabel="time [s]", ylabel="measured less fitted [mm]", title="residuals; dashed: 2 sigma"
    )
    names, deviation = [*found.values], np.sqrt(np.diag(found.covariance))
    correlation = found.covariance / np.outer(deviation, deviation)
    matrix.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    for i, j in np.argwhere(np.isfinite(correlation)):
        color = "white" if abs(correlation[i, j]) > 0.6 else BLACK
        matrix.text(
            j, i, f"{correlation[i, j]:.2f}", ha="center", va="center", fontsize=8, color=color
        )
    labels = [name if np.isfinite(found.values[name]) else f"{name} (unknown)" for name in names]
    matrix.set_xticks(range(len(names)), labels, rotation=30, ha="right")
    matrix.set_yticks(range(len(names)), labels)
    matrix.set_title("correlation of the parameters")
    matrix.grid(False)
    return np.array([curves, off, matrix])


def draw_map(data: Any, ax: Any = None) -> Any:
    """Draw stable and unstable runs, with lines of the predicted limit and the guarantee, and
    return the axes.
    """
    (axes,) = shown_axes(ax, width=7, height=5)
    stable, predicted = (
        data[name].transpose("stiffness", "dt").values for name in ("stable", "predicted")
    )
    k, dt = np.meshgrid(data["stiffness"], data["dt"], indexing="ij")
    for mask, color, marker, label in (
        (stable, BLUE, "o", "stable"),
        (~stable, RED, "x", "unstable"),
    ):
        axes.plot(k[mask], dt[mask], marker, color=color, markersize=5, label=label, clip_on=False)
    rising = data.sortby("stiffness")
    for name, dash, label in (
        ("limit", "-", "predicted at the start"),
        ("guarantee", "--", "guaranteed"),
    ):
        if np.isfinite(rising[name]).any():
            axes.plot(rising["stiffness"], rising[name], dash, color=BLACK, label=label)
    title = "{integrator}, {precision}: {steps} steps".format_map(data.attrs)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="stiffness K [N/m]",
        ylabel="time step dt [s]",
        title=title,
    )
    if (~stable & predicted).any():
        note = (
            "Crosses below the predicted limit: it is that of the initial state, and the cloth "
            "moves on to others"
        )
        axes.text(
            0.5, 1.0, note, transform=axes.transAxes, ha="center", va="bottom", fontsize="small"
        )
        axes.set_title(title, pad=20)
    axes.figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return axes
