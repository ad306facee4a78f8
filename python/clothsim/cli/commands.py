"""What each command takes, and what it does."""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import clothsim as cs
from clothsim.gpu import adapters

from ..base.files import as_json, npz_path
from ..base.progress import is_wanted_by_command, print_above_bars
from ..model import fields
from ..viewing.animation import FORMATS as FILMS
from ..viewing.animation import animate, check_film_path
from ..viewing.exports import FORMATS as EXPORTS
from ..viewing.exports import check_export_path, export
from ..viewing.picture import check_file_path

FPS = 60  # frames a second that a run stores for pages, films and exports without --every or --fps

# Options that are arguments of `simulate`, which checks them.
OPTIONS = (
    "dt",
    "every",
    "fps",
    "integrator",
    "rtol",
    "atol",
    "kernel",
    "precision",
    "threads",
    "backend",
)
READY: dict[str, Callable[..., cs.Scene]] = {
    name: getattr(cs.scenes, name)
    for name in cs.scenes.__all__
    if name not in ("PAPER_DT", "hard_cases")
}


def _add_run_arguments(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    _add_scene_arguments(command)
    add("--duration", type=float, default=1.0, metavar="S", help="seconds to simulate (default 1)")
    add("--dt", type=float, metavar="S", help="time step in seconds (default: a stable one)")
    add(
        "--every",
        type=_parse_every,
        metavar="N|S",
        help="store a frame every N steps, or every S seconds (with a point)",
    )
    add("--fps", type=float, metavar="F", help="frames a second (default: first and last only)")
    add("--integrator", metavar="NAME", help=f"one of {', '.join(cs.integrators())}")
    add(
        "--rtol",
        type=float,
        metavar="E",
        help="error asked for, relative to the cloth's longer side",
    )
    add("--atol", type=float, metavar="E", help="error asked for in metres")
    add(
        "--kernel",
        default="auto",
        metavar="NAME",
        help="auto, edge or gather (the bits of the shader)",
    )
    add("--precision", default="double", metavar="NAME", help="double or single")
    add("--threads", type=int, metavar="N", help="threads (default: automatic)")
    add("--backend", default="cpu", metavar="NAME", help="cpu or gpu")
    add("--out", metavar="FILE.npz", help="save times, positions and velocities")
    add("--html", metavar="FILE", help="write a page that plays the run")
    add("--picture", metavar="FILE", help="write a picture of the last frame")
    add("--film", metavar="FILE", help=f"write a film; its suffix is one of {', '.join(FILMS)}")
    add("--export", metavar="FILE", help=f"write files for other programs: {', '.join(EXPORTS)}")
    add(
        "--save-scene",
        metavar="FILE.toml",
        help="save the scene, with its changes, as a file to edit",
    )


def _parse_every(text: str) -> int | float:
    return int(text) if text.isdigit() else float(text)


def _run_scene(args: argparse.Namespace) -> None:
    scene = _make_scene(args)
    _check_output_files(args, scene)
    files = [cs.save_scene(scene, args.save_scene)] if args.save_scene else []
    options = {name: getattr(args, name) for name in OPTIONS}
    if (args.html or args.film or args.export) and args.every is None and args.fps is None:
        options["fps"] = FPS
    try:
        result = cs.simulate(scene, args.duration, **options, progress=is_wanted_by_command())
        _write_files_of_run(args, result, files)
    except BaseException:
        for file in files:
            print_above_bars(f"Written: {file}", sys.stderr)
        raise
    if args.json:
        print(as_json({**result.report, "files": files}))
    else:
        print("\n".join([str(result), *(f"Written: {file}" for file in files)]))


def _write_files_of_run(args: argparse.Namespace, result: cs.Run, files: list[Path]) -> None:
    """Write the files of the run, and append each to `files`."""
    progress = is_wanted_by_command()
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


def _check_output_files(args: argparse.Namespace, scene: cs.Scene) -> None:
    """Refuse files that cannot be written before the scene is simulated."""
    for name in ("out", "html", "picture", "save_scene"):
        if getattr(args, name):
            check_file_path(f"--{name.replace('_', '-')}", getattr(args, name))
    if args.out:
        args.out = npz_path(args.out, "--out")
    if args.film:
        check_film_path("--film", args.film)
    if args.export:
        check_export_path(scene, args.export, "--export")


def _add_scene_arguments(command: argparse.ArgumentParser) -> None:
    """Add the argument SCENE, and its changes."""
    command.add_argument(
        "scene",
        metavar="SCENE",
        help=f"a scene file (.toml), a hard case, or one of {', '.join(READY)}",
    )
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change the scene by a name of clothsim.sweepable(), such as stiffness=2e4, "
        "shape=(64,64), "
        "sphere_response=reflect; may be given several times",
    )


def _make_scene(args: argparse.Namespace) -> cs.Scene:
    """Make the scene that the arguments describe."""
    changes = {}
    for entry in args.set:
        name, sign, text = entry.partition("=")
        if not sign:
            raise ValueError(f"--set must be NAME=VALUE, got {entry!r}")
        if fields.check_sweep_name(name) in (*fields.RUN, "scene"):
            raise ValueError(f"--set must name an argument of the scene, got {name!r}")
        try:
            changes[name] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            changes[name] = text
    return fields.change_scene(_load_scene_of_word(args.scene), changes)


def _load_scene_of_word(text: str) -> cs.Scene:
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


def _add_live_arguments(command: argparse.ArgumentParser) -> None:
    _add_scene_arguments(command)
    command.add_argument(
        "-o", "--out", metavar="FILE", default="live.html", help="default: live.html"
    )
    command.add_argument(
        "--dt",
        type=float,
        metavar="S",
        help="time step in seconds (default: half of the guaranteed step)",
    )
    command.add_argument("--title", help="heading of the page (default: the shape of the cloth)")


def _write_live_page(args: argparse.Namespace) -> None:
    path = _make_scene(args).to_live_html(args.out, args.dt, args.title)
    print(as_json({"page": path}) if args.json else f"Page: {path}")


def _add_reproduce_arguments(command: argparse.ArgumentParser) -> None:
    from clothsim.paper import NUMBERS

    command.add_argument(
        "--quick",
        action="store_true",
        help="fewer and coarser steps: some 20 seconds on two free cores",
    )
    command.add_argument(
        "--out", default="report", metavar="DIR", help="folder of the report (default: report)"
    )
    command.add_argument("--threads", type=int, metavar="N", help="threads (default: all)")
    command.add_argument(
        "--experiment",
        type=int,
        choices=NUMBERS,
        action="append",
        help="only this one; may be given several times (default: all)",
    )


def _reproduce_experiments(args: argparse.Namespace) -> None:
    from clothsim.paper import NUMBERS, list_verdicts, report_as_text, reproduce

    numbers = args.experiment or NUMBERS
    report = reproduce(
        args.out,
        quick=args.quick,
        experiments=numbers,
        threads=args.threads,
        progress=is_wanted_by_command(),
    )
    print(as_json(report) if args.json else report_as_text(report))
    if not args.json:
        print(f"Report folder: {report['folder']} (open index.html)\n")
        print("\n".join(list_verdicts(report["experiments"])))


def _describe_adapters() -> Any:
    """Describe the adapters for the backend "gpu", or say why there are none."""
    try:
        devices = adapters()
    except ImportError as error:
        return str(error)
    return {
        f"{place}: {adapter.name}": {
            "api": adapter.api,
            "kind": adapter.kind + (" (runs shaders, no GPU)" if adapter.software else ""),
            "driver": adapter.driver,
            "float64": adapter.float64,
            "largest_buffer": adapter.largest_buffer,
        }
        for place, adapter in enumerate(devices)
    } or "none found"


def _print_info(args: argparse.Namespace) -> None:
    config = {**cs.build_config(), "graphics_adapters": _describe_adapters()}
    print(as_json(config) if args.json else "\n".join(_lines_of_mapping(config)))


def _lines_of_mapping(data: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    for name, value in data.items():
        if isinstance(value, Mapping):
            yield f"{indent}{name}:"
            yield from _lines_of_mapping(value, indent + "  ")
        elif isinstance(value, list):
            yield f"{indent}{name}: {', '.join(map(str, value))}"
        else:
            yield f"{indent}{name}: {value}"


# The help of each command, what adds its arguments, and what runs it.
COMMANDS = {
    "run": (
        "Simulate a scene, print its report, and write files of it.",
        _add_run_arguments,
        _run_scene,
    ),
    "live": (
        "Write a page that simulates a scene in the browser, by WebGPU.",
        _add_live_arguments,
        _write_live_page,
    ),
    "reproduce": (
        "Run the experiments of Kim et al. and write a report.",
        _add_reproduce_arguments,
        _reproduce_experiments,
    ),
    "info": (
        "Print the build, instruction sets, threads, libraries and graphics adapters.",
        lambda command: None,
        _print_info,
    ),
}
