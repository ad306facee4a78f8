"""`clothsim plot`: draw a stored sweep or a saved run."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import clothsim as cs

from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ..viewing.animation import FORMATS, animate
from ..viewing.chart import plot
from ..viewing.page import run_to_html
from ..viewing.sweep_plots import KINDS
from ._common import add_command
from .sweep import save_plot

KINDS_OF_RUN = ("curves", "picture")


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "plot", run)
    command.add_argument(
        "store", metavar="STORE|RUN.npz", help="what `clothsim sweep --store` or `clothsim run --out` has written"
    )
    command.add_argument(
        "--kind",
        choices=(*KINDS, *KINDS_OF_RUN),
        help="of a run: curves (default) or picture, its last frame; default of a sweep: what fits best",
    )
    command.add_argument("--metric", metavar="NAME", help="of a heat map (default: the first)")
    command.add_argument(
        "--select",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="of a dimension that the picture has no room for, the value nearest to this one",
    )
    command.add_argument(
        "--out",
        metavar="FILE",
        help="default: beside the store, .png; of a run also .html (a page that plays it), .gif, .webp, .mp4",
    )


def run(args: argparse.Namespace) -> None:
    if args.store.endswith(".npz"):
        _plot_run(args)
    else:
        _plot_sweep(args)


def _plot_run(args: argparse.Namespace) -> None:
    for option, given in (("--metric", args.metric), ("--select", args.select)):
        if given:
            raise ValueError(f"{option} is for a sweep, got the run {args.store!r}")
    if args.kind in KINDS:
        kinds = " or ".join(KINDS_OF_RUN)
        raise ValueError(f"--kind must be {kinds} for a run, got {args.kind!r}")
    path = Path(args.out or Path(args.store).with_suffix(".png"))
    if not path.parent.is_dir():
        raise ValueError(f"--out must be in an existing folder, got {str(path)!r}")
    result = cs.load_run(args.store)
    if path.suffix.lower() in (".html", *FORMATS):
        if args.kind:
            raise ValueError(f"--kind does not go with {path.suffix}, which plays the run")
        if path.suffix.lower() == ".html":
            run_to_html(result, path, progress=wanted_by_command())
        else:
            animate(result, path, progress=wanted_by_command())
    elif args.kind == "picture":
        result.picture(path=path)
    else:
        plot(result, path, progress=wanted_by_command())
    print(as_json({"picture": str(path)}) if args.json else f"Picture: {path}")


def _plot_sweep(args: argparse.Namespace) -> None:
    if args.kind in KINDS_OF_RUN:
        raise ValueError(f"--kind {args.kind} is for a run (.npz), got the sweep {args.store!r}")
    dataset = cs.open_sweep(args.store)
    for entry in args.select:
        dataset = _select(dataset, entry)
    if args.metric and args.kind not in (None, "heatmap"):
        raise ValueError(f"--metric is for --kind heatmap, got --kind {args.kind}")
    kind = "heatmap" if args.metric else args.kind
    picture = args.out or os.path.splitext(args.store.rstrip("/"))[0] + ".png"
    if not Path(picture).parent.is_dir():
        raise ValueError(f"--out must be in an existing folder, got {picture!r}")
    options = {"variable": args.metric} if args.metric else {}
    save_plot(dataset.load(), picture, kind, **options)
    print(as_json({"picture": picture}) if args.json else f"Picture: {picture}")


def _select(dataset: Any, entry: str) -> Any:
    name, sign, text = entry.partition("=")
    if not sign or name not in dataset["status"].dims:
        names = ", ".join(dataset["status"].dims)
        raise ValueError(f"--select must be NAME=VALUE with a name of {names}, got {entry!r}")
    if dataset[name].dtype.kind in "iuf":
        return dataset.sel({name: float(text)}, method="nearest")
    if text not in dataset[name].values:
        raise ValueError(f"--select {name} must be one of {list(dataset[name].values)}, got {text!r}")
    return dataset.sel({name: text})
