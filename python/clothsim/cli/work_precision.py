"""`clothsim work-precision`: error against cost of every integrator, and the fastest integrator at each error."""

from __future__ import annotations

import argparse
import inspect
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.accuracy import fastest
from clothsim.accuracy.front import ERRORS
from clothsim.accuracy.work_table import rows_of, text_of_runs, write_runs
from clothsim.base import check

from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ..engine.options import PRECISIONS
from ._common import add_command, count, refuse_ignored
from ._scenes import SCENE_HELP, ready_scenes, scene_of


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "work-precision", run)
    command.add_argument(
        "scene",
        nargs="?",
        default="paper_swing",
        metavar="SCENE",
        help=f"{SCENE_HELP}; without contact (default: paper_swing)",
    )
    command.add_argument("--bend", action="store_true", help="with bend springs (paper_* scenes)")
    command.add_argument("--duration", type=float, default=0.5, metavar="S", help="seconds to simulate (default 0.5)")
    command.add_argument(
        "--method",
        action="append",
        metavar="NAME",
        help="only this integrator at fixed steps, or 'NAME adaptive' at tolerances; may be given "
        "several times (default: all)",
    )
    command.add_argument("--precision", action="append", choices=("double", "single"), help="only this one (default: both)")
    command.add_argument("--threads", type=count, metavar="N", help="threads (default: automatic)")
    command.add_argument("--windows", type=count, default=5, metavar="N", help="timed runs of each (default 5)")
    command.add_argument(
        "--fastest",
        action="store_true",
        help="instead: at each error the fastest method, at the cheapest setting that reaches it",
    )
    command.add_argument(
        "--errors", metavar="E,E,...", help="rms errors [m] of --fastest, with commas between them (default: 1e-4 to 1e-12)"
    )
    command.add_argument(
        "--out",
        default="work-precision",
        metavar="DIR",
        help="folder of the CSV and the picture, made if missing (default: work-precision)",
    )


def run(args: argparse.Namespace) -> None:
    precisions = args.precision or PRECISIONS
    progress = wanted_by_command()
    if args.fastest:
        _fastest(args, precisions, progress)
        return
    if args.errors is not None:
        raise ValueError("--errors needs --fastest")
    folder = check.folder("--out", args.out)
    options = {"precisions": precisions, "threads": args.threads, "windows": args.windows, "progress": progress}
    data = cs.work_precision(_scene(args), args.duration, args.method, **options)
    folder.mkdir(parents=True, exist_ok=True)
    files = write_runs(data, folder / f"{Path(args.scene).stem}{'_bend' if args.bend else ''}")
    if args.json:
        names = [str(file) for file in files]
        print(as_json({"attributes": data.attrs, "runs": rows_of(data), "files": names}))
        return
    print(text_of_runs(data))
    print("Written: " + ", ".join(map(str, files)))


def _scene(args: argparse.Namespace) -> cs.Scene:
    if not args.bend:
        return scene_of(args.scene)
    function = ready_scenes().get(args.scene, scene_of)
    if "bend" not in inspect.signature(function).parameters:
        raise ValueError(f"--bend does not go with {args.scene}, which has no bend springs to add")
    return function(bend=True)


def _errors(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--errors must be numbers with commas between them, such as 1e-6,1e-9; got {text!r}") from None


def _fastest(args: argparse.Namespace, precisions: Any, progress: bool) -> None:
    refuse_ignored(args, "--fastest", ["--out"])
    options = {"methods": args.method, "precisions": precisions, "windows": args.windows, "progress": progress}
    wanted = ERRORS if args.errors is None else _errors(args.errors)
    found = fastest(_scene(args), args.duration, wanted, threads=args.threads, **options)
    print(as_json(found.statement()) if args.json else found)
