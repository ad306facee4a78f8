"""`clothsim plot`: draw a stored sweep."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.sweep.plots import KINDS

from .._json import as_json
from ._common import add_command
from .sweep import save_plot


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "plot", run, "Draw a stored sweep.")
    command.add_argument("store", metavar="STORE", help="what `clothsim sweep --store` has written")
    command.add_argument("--kind", choices=KINDS, help="default: what fits the sweep best")
    command.add_argument("--metric", metavar="NAME", help="of a heat map (default: the first)")
    command.add_argument(
        "--select", action="append", default=[], metavar="NAME=VALUE",
        help="of a dimension that the picture has no room for, the value nearest to this one",
    )  # fmt: skip
    command.add_argument("--out", metavar="FILE", help="default: beside the store, .png")


def run(args: argparse.Namespace) -> None:
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
        raise ValueError(
            f"--select {name} must be one of {list(dataset[name].values)}, got {text!r}"
        )
    return dataset.sel({name: text})
