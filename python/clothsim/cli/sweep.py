"""`clothsim sweep`: run a scene for every combination of values."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.sweeps import fields
from clothsim.sweeps.metrics import DEFAULT_METRICS, METRICS

from ..base.extras import check_installed, needed
from ..base.plain_json import as_json
from ..base.plots import save
from ..base.progress import wanted_by_command
from ._common import EVERY_HELP, add_command, count, every
from ._scenes import SCENE_HELP, named_values, option, parsed, parsed_range, scene_of

_SPEC = (
    "VALUES: numbers or names with commas between, and ranges first:last:log9 (nine values, equal "
    "ratios) or first:last:lin9 (equal steps); a shape is ROWSxCOLUMNS or N, a vector X;Y;Z, "
    "and none a dt, rtol or atol that is not given. One "
    "value is a setting, several make a dimension of the result."
)

# Names that an option cannot express.
_NOT_OPTIONS = ("scene", "position", "velocity", "force", "pins", "sphere_motion", "sphere_times", "sphere_centers")


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "sweep", run)
    command.allow_abbrev = False
    command.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    command.add_argument(
        "--metric",
        default=",".join(DEFAULT_METRICS),
        metavar="NAMES",
        help=f"with commas between, of: {', '.join(METRICS)} (default: %(default)s)",
    )
    command.add_argument(
        "--zip",
        action="append",
        default=[],
        metavar="NAMES",
        help="take the values of these names side by side, not in all combinations",
    )
    command.add_argument("--store", metavar="DIR", help="keep the results in a zarr store")
    command.add_argument(
        "--resume",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="do what is missing in a store that exists (default), or refuse the store",
    )
    command.add_argument("--every", type=every, metavar="N|S|step", help=EVERY_HELP)
    command.add_argument("--frames", action="store_true", help="store the frames too")
    command.add_argument("--threads", type=count, metavar="N", help="threads (default: all)")
    command.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster that does the work")
    command.add_argument(
        "--plot", nargs="?", const="", metavar="FILE", help="draw the result (default: sweep.png, or beside the store)"
    )
    group = command.add_argument_group("what can be swept", _SPEC)
    for name in fields.NAMES:
        if name not in _NOT_OPTIONS:
            unit = fields.units(name)
            group.add_argument(option(name), metavar="VALUES", dest=f"over_{name}", help=unit and f"[{unit}]")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUES",
        help="the same for a name that has no option, as sphere1_radius",
    )


def run(args: argparse.Namespace) -> None:
    scene = scene_of(args.scene)
    values = {name: parse_values(name, text) for name, text in named_values(args, "over_").items()}
    single = {name: several[0] for name, several in values.items() if len(several) == 1}
    of_scene, settings = fields.split(single)
    scene = fields.change_scene(scene, of_scene)
    over = {name: several for name, several in values.items() if len(several) > 1}
    for group in args.zip:
        over = _zipped(over, tuple(group.replace("-", "_").split(",")))
    if args.store and Path(args.store).exists() and not args.resume:
        raise ValueError(f"--store {args.store} exists; without --no-resume it would be continued")
    picture = _picture(args)
    settings |= {name: getattr(args, name) for name in ("every", "frames", "store", "resume", "threads")}
    executor = None
    if args.scheduler is not None:
        executor = needed("distributed", "--scheduler", "dask").Client(args.scheduler)
    dataset = cs.sweep(
        scene, over, metrics=args.metric.split(","), executor=executor, progress=wanted_by_command(), **settings
    )
    print(as_json(as_data(dataset)) if args.json else summary(dataset))
    if picture is not None:
        save_plot(dataset, picture)
        if not args.json:
            print(f"Picture: {picture}")
    if args.store and not args.json:
        print(f"Store: {args.store} (clothsim plot {args.store}; cs.open_sweep)")


def parse_values(name: str, text: str) -> list[Any]:
    """Parse the text of an option into values.

    Examples
    --------
    >>> parse_values("stiffness", "1e3:1e5:log3")
    [1000.0, 10000.0, 100000.0]
    >>> parse_values("shape", "16x16,32x32")
    [(16, 16), (32, 32)]
    >>> parse_values("integrator", "rk4")
    ['rk4']
    """
    values: list[Any] = []
    for item in text.split(","):
        values += parsed_range(name, item) if ":" in item else [parsed(name, item.strip())]
    return values


def _zipped(over: dict[Any, Any], names: tuple[str, ...]) -> dict[Any, Any]:
    missing = [name for name in names if name not in over]
    if missing or len(names) < 2:
        raise ValueError(f"--zip must be names that have several values, got {','.join(names)}")
    lengths = {name: len(over[name]) for name in names}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"--zip needs as many values of each name, got {lengths}")
    rows = list(zip(*(over[name] for name in names), strict=True))
    return {names: rows, **{key: values for key, values in over.items() if key not in names}}


def _picture(args: argparse.Namespace) -> str | None:
    if args.plot is None:
        return None
    default = os.path.splitext(args.store.rstrip("/"))[0] + ".png" if args.store else "sweep.png"
    check_installed("matplotlib", "--plot", "plot")
    picture = args.plot or default
    if not (Path(picture).parent).is_dir():
        raise ValueError(f"--plot must be in an existing folder, got {picture!r}")
    return picture


def save_plot(dataset: Any, picture: str, kind: str | None = None, **options: Any) -> None:
    """Draw without a display and write the picture."""
    import matplotlib

    matplotlib.use("Agg")
    axes = dataset.clothsim.plot(kind, **options)
    save(axes.figure, Path(picture))


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
