"""`clothsim live`: write a page that simulates a scene in the browser."""

from __future__ import annotations

import argparse

from ..base.files import as_json
from .run import add_scene, changed_scene


def add_arguments(command: argparse.ArgumentParser) -> None:
    add_scene(command)
    command.add_argument("-o", "--out", metavar="FILE", default="live.html", help="default: live.html")
    command.add_argument("--dt", type=float, metavar="S", help="time step in seconds (default: half of the guaranteed step)")
    command.add_argument("--title", help="heading of the page (default: the shape of the cloth)")


def run(args: argparse.Namespace) -> None:
    path = changed_scene(args).to_live_html(args.out, args.dt, args.title)
    print(as_json({"page": path}) if args.json else f"Page: {path}")
