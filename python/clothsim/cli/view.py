"""`clothsim view`: step a scene live, in the browser."""

from __future__ import annotations

import argparse
from typing import Any

from clothsim.viewing.live import view

from ._common import add_command
from ._scenes import SCENE_HELP, add_changes, changed_scene


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "view", run)
    command.add_argument(
        "scene", metavar="SCENE", nargs="?", default="paper_static", help=f"{SCENE_HELP} (default: paper_static)"
    )
    command.add_argument(
        "--dt", type=float, metavar="S", help="time step in seconds (default: what this machine keeps up with)"
    )
    command.add_argument("--precision", choices=("double", "single"), default="double", help="default: double")
    command.add_argument("--host", default="127.0.0.1", help="address to serve at (default: this machine alone)")
    command.add_argument("--port", type=int, default=8080, help="default: 8080, or the next that is free")
    add_changes(command)


def run(args: argparse.Namespace) -> None:
    view(changed_scene(args), dt=args.dt, precision=args.precision, host=args.host, port=args.port)
