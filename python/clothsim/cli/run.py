"""`clothsim run`: simulate a scene, print its report, and write files of it."""

from __future__ import annotations

import argparse
import ast
import inspect
import sys
from collections.abc import Callable
from pathlib import Path

import clothsim as cs

from ..base.files import as_json, npz_path
from ..base.progress import print_above, wanted_by_command
from ..model import fields
from ..viewing.animation import FORMATS as FILMS
from ..viewing.animation import animate, film_path
from ..viewing.exports import FORMATS as EXPORTS
from ..viewing.exports import checked, export
from ..viewing.picture import file_path

FPS = 60  # frames a second that a run stores for pages, films and exports without --every or --fps

# Options that are arguments of `simulate`, which checks them.
OPTIONS = ("dt", "every", "fps", "integrator", "rtol", "atol", "kernel", "precision", "threads", "backend")


def add_arguments(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add_scene(command)
    add("--duration", type=float, default=1.0, metavar="S", help="seconds to simulate (default 1)")
    add("--dt", type=float, metavar="S", help="time step in seconds (default: a stable one)")
    add("--every", type=_every, metavar="N|S", help="store a frame every N steps, or every S seconds (with a point)")
    add("--fps", type=float, metavar="F", help="frames a second (default: first and last only)")
    add("--integrator", metavar="NAME", help=f"one of {', '.join(cs.integrators())}")
    add("--rtol", type=float, metavar="E", help="error asked for, relative to the cloth's longer side")
    add("--atol", type=float, metavar="E", help="error asked for in metres")
    add("--kernel", default="auto", metavar="NAME", help="auto, edge or gather (the bits of the shader)")
    add("--precision", default="double", metavar="NAME", help="double or single")
    add("--threads", type=int, metavar="N", help="threads (default: automatic)")
    add("--backend", default="cpu", metavar="NAME", help="cpu or gpu")
    add("--out", metavar="FILE.npz", help="save times, positions and velocities")
    add("--html", metavar="FILE", help="write a page that plays the run")
    add("--picture", metavar="FILE", help="write a picture of the last frame")
    add("--film", metavar="FILE", help=f"write a film; its suffix is one of {', '.join(FILMS)}")
    add("--export", metavar="FILE", help=f"write files for other programs: {', '.join(EXPORTS)}")
    add("--save-scene", metavar="FILE.toml", help="save the scene, with its changes, as a file to edit")


def _every(text: str) -> int | float:
    return int(text) if text.isdigit() else float(text)


def run(args: argparse.Namespace) -> None:
    scene = changed_scene(args)
    _check_files(args, scene)
    files = [cs.save_scene(scene, args.save_scene)] if args.save_scene else []
    options = {name: getattr(args, name) for name in OPTIONS}
    if (args.html or args.film or args.export) and args.every is None and args.fps is None:
        options["fps"] = FPS
    try:
        result = cs.simulate(scene, args.duration, **options, progress=wanted_by_command())
        _write(args, result, files)
    except BaseException:
        for file in files:
            print_above(f"Written: {file}", sys.stderr)
        raise
    if args.json:
        print(as_json({**result.report, "files": files}))
    else:
        print("\n".join([str(result), *(f"Written: {file}" for file in files)]))


def _write(args: argparse.Namespace, result: cs.Run, files: list[Path]) -> None:
    """Write the files of the run, and append each to `files`."""
    progress = wanted_by_command()
    if args.out:
        files.append(result.save(args.out))
    if args.html:
        files.append(result.to_html(args.html, title=Path(args.scene).stem))
    if args.picture:
        result.picture(path=args.picture)
        files.append(Path(args.picture))
    if args.film:
        files.append(animate(result, args.film, progress=progress))
    if args.export:
        files += export(result, args.export, progress=progress)


def _check_files(args: argparse.Namespace, scene: cs.Scene) -> None:
    """Refuse files that cannot be written before the scene is simulated."""
    for name in ("out", "html", "picture", "save_scene"):
        if getattr(args, name):
            file_path(f"--{name.replace('_', '-')}", getattr(args, name))
    if args.out:
        args.out = npz_path(args.out, "--out")
    if args.film:
        film_path("--film", args.film)
    if args.export:
        checked(scene, args.export, "--export")


READY: dict[str, Callable[..., cs.Scene]] = {
    name: function
    for name, function in inspect.getmembers(cs.scenes, inspect.isfunction)
    if function.__annotations__.get("return") == "Scene"
}


def add_scene(command: argparse.ArgumentParser) -> None:
    """The argument SCENE, and its changes."""
    command.add_argument("scene", metavar="SCENE", help=f"a scene file (.toml), a hard case, or one of {', '.join(READY)}")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change the scene by a name of clothsim.sweepable(), such as stiffness=2e4, shape=(64,64), "
        "sphere_response=continuous; may be given several times",
    )


def changed_scene(args: argparse.Namespace) -> cs.Scene:
    """The scene that the arguments describe."""
    changes = {}
    for entry in args.set:
        name, sign, text = entry.partition("=")
        if not sign:
            raise ValueError(f"--set must be NAME=VALUE, got {entry!r}")
        if fields.check_name(name) in (*fields.RUN, "scene"):
            raise ValueError(f"--set must name an argument of the scene, got {name!r}")
        try:
            changes[name] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            changes[name] = text
    return fields.change_scene(_scene(args.scene), changes)


def _scene(text: str) -> cs.Scene:
    if text.endswith(".toml"):
        return cs.load_scene(text)
    if text in READY:
        return READY[text]()
    hard = cs.scenes.hard_cases()
    if text not in hard:
        names = ", ".join([*READY, *map(repr, hard)])
        raise ValueError(f"SCENE must be a file that ends in .toml or one of {names}, got {text!r}")
    scene: cs.Scene = hard[text].scene
    return scene
