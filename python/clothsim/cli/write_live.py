"""`clothsim live`: write a page that simulates a scene in the browser."""

from __future__ import annotations

import argparse
from typing import Any

from ..base.plain_json import as_json
from ._common import add_command
from ._scenes import SCENE_HELP, add_changes, changed_scene


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "live", run)
    command.add_argument(
        "scene", metavar="SCENE", nargs="?", default="paper_static", help=f"{SCENE_HELP} (default: paper_static)"
    )
    command.add_argument("-o", "--out", metavar="FILE", default="live.html", help="default: live.html")
    command.add_argument("--dt", type=float, metavar="S", help="time step in seconds (default: half of the guaranteed step)")
    command.add_argument("--title", help="heading of the page (default: the shape of the cloth)")
    add_changes(command)


def run(args: argparse.Namespace) -> None:
    path = str(changed_scene(args).to_live_html(args.out, args.dt, args.title))
    print(as_json({"page": path}) if args.json else f"Page: {path}")
