"""`clothsim run`: simulate a scene and print its report."""

from __future__ import annotations

import argparse
import tempfile
import webbrowser
from pathlib import Path
from typing import Any

import clothsim as cs

from ..base.files import npz_path
from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ..engine.options import KERNELS
from ..viewing.animation import FORMATS as FILMS
from ..viewing.animation import animate, film_path
from ..viewing.exports import Target, export
from ..viewing.page import run_to_html
from ..viewing.picture import file_path
from ._common import EVERY_HELP, add_command, as_table, count, every, integrator, short, written
from ._scenes import SCENE_HELP, add_changes, changed_scene

FPS = 60  # frames a second that a run stores for pages, films and exports without --every or --fps

# Options of the command that are arguments of `simulate`.
OPTIONS = ("dt", "every", "fps", "integrator", "rtol", "atol", "kernel", "strict", "precision", "threads", "backend")
# Of the entries of a run's report; what is inside an entry has the entry's unit unless it is here.
UNITS = {
    "wall_time": "s",
    "estimate_wall_time": "s",
    "dt": "s",
    "error_estimate": "m",
    "asked": "m",
    "energy": "J",
    "penetration": "m",
    "first_contact": "s",
    "time": "s",
    "impulse": "N s",
    "centre_of_mass": "m",
    "center_of_mass": "m",
    "kinetic_energy": "J",
    "total_energy": "J",
}


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "run", run)
    command.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    command.add_argument("--duration", type=float, default=1.0, metavar="S", help="seconds to simulate (default 1)")
    command.add_argument("--dt", type=float, metavar="S", help="time step in seconds (default: a stable one)")
    stored = command.add_mutually_exclusive_group()
    stored.add_argument("--every", type=every, metavar="N|S|step", help=EVERY_HELP)
    stored.add_argument("--fps", type=float, metavar="F", help="frames a second")
    command.add_argument("--precision", choices=("double", "single"), default="double", help="default: double")
    command.add_argument("--threads", type=count, metavar="N", help="threads (default: automatic)")
    command.add_argument("--backend", choices=("cpu", "gpu"), default="cpu", help="default: cpu (gpu: docs/gpu.md)")
    _add_method(command)
    _add_files(command)
    add_changes(command)


def _add_files(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", metavar="FILE.npz", help="save times, positions and velocities")
    command.add_argument("--html", metavar="FILE", help="write a page that plays the run")
    command.add_argument("--view", action="store_true", help="play the run in the web browser: --html, opened")
    command.add_argument(
        "--film", "--gif", dest="film", metavar="FILE", help=f"write a film; its suffix is one of {', '.join(FILMS)}"
    )
    command.add_argument("--export", metavar="FILE", help="write files for other programs, as `clothsim export` does")
    command.add_argument("--z-up", action="store_true", help="--export: turn the y axis to z")


def _add_method(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--integrator",
        type=_integrator,
        metavar="NAME",
        help=f"auto or one of {', '.join(cs.integrators())} (default: auto with --rtol or --atol, else rk4)",
    )
    command.add_argument("--rtol", type=float, metavar="E", help="error asked for, relative to the cloth's longer side")
    command.add_argument("--atol", type=float, metavar="E", help="error asked for in metres")
    command.add_argument("--kernel", choices=KERNELS, default="auto", help="default: auto (gather: the shader's)")
    command.add_argument("--strict", action="store_true", help="same bits on every instruction set and the shader")


def _integrator(text: str) -> str:
    return text if text == "auto" else integrator(text)


def run(args: argparse.Namespace) -> None:
    scene = changed_scene(args)
    _check_files(args, scene)
    options = {name: getattr(args, name) for name in OPTIONS}
    result = cs.simulate(scene, args.duration, **options, progress=wanted_by_command())
    groups = _write_films(args, result)
    report = dict(result.report)
    if args.json:
        files = [file for group in groups for file in group]
        print(as_json(report | ({"files": files} if files else {})))
        return
    print(as_table(_examined(report, args), UNITS))
    for group in groups:
        print(written(group))


def _examined(report: dict[str, Any], args: argparse.Namespace) -> dict[str, Any]:
    """The report without searches that did not happen: a given time step has no tolerance and no test of chaos."""
    for name in ("residual", "reason", *(() if report["impulse_reason"] else ("impulse_reason",))):
        del report[name]
    if args.dt is not None:
        absent = ("tolerance", "chaotic", "outcomes", "estimate_evaluations", "estimate_wall_time")
        return {name: value for name, value in report.items() if name not in absent}
    if args.rtol is None and args.atol is None:
        aim, reached = report["tolerance"]["asked"], report["tolerance"]["reached"]
        report["tolerance"] = f"{short(aim, 'm')} by default, {'reached' if reached else 'not reached'}"
    return report


def _check_files(args: argparse.Namespace, scene: cs.Scene) -> None:
    """Refuse files that cannot be written before the scene is simulated."""
    for name in ("out", "html"):
        if getattr(args, name):
            file_path(f"--{name}", getattr(args, name))
    if args.out:
        args.out = npz_path(args.out, "--out")
    if args.film:
        film_path("--film", args.film)
    if args.export:
        Target.of(scene, args.export, FPS, args.z_up, "--export")
    elif args.z_up:
        raise ValueError("--z-up needs --export, whose files it turns")
    if args.view and not args.html:
        args.html = str(Path(tempfile.mkdtemp(prefix="clothsim-")) / "run.html")
    if (args.html or args.film or args.export) and args.every is None and args.fps is None:
        args.fps = FPS


def _write_films(args: argparse.Namespace, result: cs.Run) -> list[list[Path]]:
    """Files of --out, --html, --film and --export."""
    shown = wanted_by_command()
    groups = [[result.save(args.out)]] if args.out else []
    if args.html:
        groups.append([run_to_html(result, args.html, progress=shown)])
        if args.view and not webbrowser.open(groups[-1][0].resolve().as_uri()):
            raise RuntimeError(f"no web browser was found: open {args.html} in one")
    if args.film:
        groups.append([animate(result, args.film, progress=shown)])
    if args.export:
        groups.append(export(result, args.export, FPS, args.z_up, progress=shown))
    return groups
