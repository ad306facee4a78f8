"""`clothsim run`: simulate a ready scene and print its report."""

from __future__ import annotations

import argparse
import difflib
import inspect
import tempfile
import webbrowser
from collections.abc import Callable
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
from ._common import EVERY_HELP, add_command, as_table, count, every, integrator, written

FPS = 60  # frames a second that a run stores for pages, films and exports without --every or --fps

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
    "centre_of_mass": "m",
    "center_of_mass": "m",
    "kinetic_energy": "J",
    "total_energy": "J",
}


def ready_scenes() -> dict[str, Callable[..., cs.Scene]]:
    """The functions of `clothsim.model.ready` that return a scene, by name."""
    return {
        name: function
        for name, function in inspect.getmembers(cs.scenes, inspect.isfunction)
        if not name.startswith("_") and function.__annotations__.get("return") == "Scene"
    }


def scene_of(text: str) -> cs.Scene:
    """The scene of a file, or the ready one of that name."""
    ready = ready_scenes()
    if text in ready:
        return ready[text]()
    if not text.endswith(".toml"):
        close = difflib.get_close_matches(text, ready, 1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ValueError(f"SCENE must be a file that ends in .toml or one of {', '.join(ready)}, got {text!r}{hint}")
    return cs.load_scene(text)


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "run", run)
    command.add_argument("scene", metavar="SCENE", help=_scene_help())
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


def _add_files(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", metavar="FILE.npz", help="save times, positions and velocities")
    command.add_argument("--html", metavar="FILE", help="write a page that plays the run")
    command.add_argument("--view", action="store_true", help="play the run in the web browser: --html, opened")
    command.add_argument("--gif", metavar="FILE", help=f"write a film; its suffix is one of {', '.join(FILMS)}")
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


def _scene_help() -> str:
    return "a scene file (TOML), or one of " + ", ".join(ready_scenes())


def run(args: argparse.Namespace) -> None:
    scene = scene_of(args.scene)
    _check_files(args, scene)
    result = cs.simulate(
        scene,
        args.duration,
        dt=args.dt,
        every=args.every,
        fps=args.fps,
        integrator=args.integrator,
        rtol=args.rtol,
        atol=args.atol,
        kernel=args.kernel,
        strict=args.strict,
        precision=args.precision,
        threads=args.threads,
        backend=args.backend,
        progress=wanted_by_command(),
    )
    if args.out:
        result.save(args.out)
    groups = _write_films(args, result)
    report = dict(result.report)
    if args.json:
        files = [file for group in groups for file in group]
        print(as_json(report | ({"files": files} if files else {})))
        return
    print(as_table(report, UNITS))
    for group in groups:
        print(written(group))


def _check_files(args: argparse.Namespace, scene: cs.Scene) -> None:
    """Refuse files that cannot be written before the scene is simulated."""
    for name in ("out", "html"):
        if getattr(args, name):
            file_path(f"--{name}", getattr(args, name))
    if args.out:
        args.out = npz_path(args.out, "--out")
    if args.gif:
        film_path("--gif", args.gif)
    if args.export:
        Target.of(scene, args.export, FPS, args.z_up, "--export")
    elif args.z_up:
        raise ValueError("--z-up needs --export, whose files it turns")
    if args.view and not args.html:
        args.html = str(Path(tempfile.mkdtemp(prefix="clothsim-")) / "run.html")
    if (args.html or args.gif or args.export) and args.every is None and args.fps is None:
        args.fps = FPS


def _write_films(args: argparse.Namespace, result: cs.Run) -> list[list[Path]]:
    """Files of --html, --gif and --export."""
    shown, groups = wanted_by_command(), []
    if args.html:
        groups.append([run_to_html(result, args.html, progress=shown)])
        if args.view and not webbrowser.open(groups[-1][0].resolve().as_uri()):
            raise RuntimeError(f"no web browser was found: open {args.html} in one")
    if args.gif:
        groups.append([animate(result, args.gif, progress=shown)])
    if args.export:
        groups.append(export(result, args.export, FPS, args.z_up, progress=shown))
    return groups
