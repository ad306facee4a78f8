"""`clothsim export`: write a saved run as files that other programs read."""

from __future__ import annotations

import argparse
from typing import Any

import clothsim as cs
from clothsim.viewing.exports import SUFFIXES, export

from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ._common import add_command, written


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "export", run)
    command.add_argument("run_file", metavar="RUN.npz", help="what `clothsim run --out` has written")
    command.add_argument("file", metavar="FILE", help=f"file to write; its suffix is one of {', '.join(SUFFIXES)}")
    command.add_argument(
        "--fps",
        type=frame_rate,
        default=60.0,
        metavar="N",
        help='frames a second, or "stored" for the frames of the run as they are (default 60)',
    )
    command.add_argument("--z-up", action="store_true", help="turn the y axis of the run to z, for Blender")


def frame_rate(text: str) -> float | None:
    """A number of frames a second, or None for "stored"."""
    if text == "stored":
        return None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'must be a number or "stored", got {text!r}') from None


def run(args: argparse.Namespace) -> None:
    files = export(cs.load_run(args.run_file), args.file, args.fps, args.z_up, progress=wanted_by_command())
    print(as_json({"files": files}) if args.json else written(files))
