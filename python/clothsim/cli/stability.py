"""`clothsim stability`: the map of stable time steps, or the hard cases."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.base import check
from clothsim.engine.options import PRECISIONS
from clothsim.hard_cases.case_table import hard_case_table, run_hard_cases
from clothsim.stability.map import measure_map
from clothsim.stability.map_report import map_rows, map_table, plot_map

from ..base.extras import check_installed
from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ..base.table import write_csv
from ._common import add_command, count, integrator, refuse_ignored
from ._scenes import SCENE_HELP, scene_of

_OF_THE_MAP = ("--scene", "--stiffness", "--dt", "--cells", "--integrator", "--precision", "--steps", "--threads", "--out")


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "stability", run)
    command.add_argument("--hard-cases", action="store_true", help="run these instead of a map")
    command.add_argument("--scene", default="paper_swing", metavar="SCENE", help=f"{SCENE_HELP} (default: paper_swing)")
    command.add_argument(
        "--stiffness",
        type=_positive,
        nargs=2,
        default=(1e2, 1e7),
        metavar=("LOW", "HIGH"),
        help="range in N/m (default: 1e2 1e7)",
    )
    command.add_argument(
        "--dt",
        type=_positive,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="range in seconds (default: 0.7 of the lowest to 1.5 of the highest predicted limit)",
    )
    command.add_argument(
        "--cells",
        type=count,
        nargs=2,
        default=(6, 24),
        metavar=("K", "DT"),
        help="number of stiffnesses and of time steps, evenly spaced in the logarithm (default: 6 24)",
    )
    command.add_argument(
        "--integrator",
        type=integrator,
        default="rk4",
        metavar="NAME",
        help=f"one of {', '.join(cs.integrators())} (default: rk4)",
    )
    command.add_argument("--precision", choices=PRECISIONS, default="double", help="of the map (default: double)")
    command.add_argument("--steps", type=count, default=1000, metavar="N", help="of each run (default: 1000)")
    command.add_argument("--threads", type=count, metavar="N", help="threads (default: all)")
    command.add_argument(
        "--out", metavar="DIR", help="folder of stability.png and stability.csv, made if missing (default: none are written)"
    )


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a finite number > 0, got {text!r}")
    return value


def run(args: argparse.Namespace) -> None:
    if args.hard_cases:
        _hard_cases(args)
    else:
        _map(args)


def _hard_cases(args: argparse.Namespace) -> None:
    refuse_ignored(args, "--hard-cases", _OF_THE_MAP)
    results = run_hard_cases(cs.scenes.hard_cases(), progress=wanted_by_command())
    print(as_json(results) if args.json else hard_case_table(results))
    failed = [r["case"] for r in results if not r["passed"]]
    if failed:
        raise ArithmeticError(f"not as expected: {', '.join(dict.fromkeys(failed))}")


def _map(args: argparse.Namespace) -> None:
    folder = check.folder("--out", args.out) if args.out else None
    if folder:
        check_installed("matplotlib", "a picture", "plot")
    scene = scene_of(args.scene, "--scene")
    softest, hardest = args.stiffness
    shortest, longest = args.dt or _range(args, scene)
    stiffness = np.geomspace(softest, hardest, args.cells[0])
    dt = np.geomspace(shortest, longest, args.cells[1])
    options = args.integrator, args.precision, args.steps, args.threads
    found = measure_map(scene, stiffness, dt, *options, progress=wanted_by_command())
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        plot_map(found, folder / "stability.png")
        write_csv(folder / "stability.csv", map_rows(found))
    if args.json:
        data = {name: getattr(found, name) for name in (*found.__dataclass_fields__, "predicted")}
        print(as_json(data))
        return
    print(map_table(found))
    if folder:
        print(f"Written: {folder / 'stability.png'}, {folder / 'stability.csv'}")


def _range(args: argparse.Namespace, scene: cs.Scene) -> tuple[float, float]:
    limits = [
        cs.max_stable_dt(scene.replace(cloth=scene.cloth.replace(stiffness=k)), args.integrator, scene.initial_position)
        for k in args.stiffness
    ]
    if not np.isfinite(limits).all():
        raise ValueError(f"--dt must be given: no time step limits {args.integrator}")
    return 0.7 * min(limits), 1.5 * max(limits)
