"""`clothsim scene`: print a scene as the text of a scene file."""

from __future__ import annotations

import argparse
from typing import Any

from clothsim.model.scene_files import scene_text

from ..base.plain_json import as_json
from ._common import add_command
from ._scenes import SCENE_HELP, add_changes, changed_scene


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "scene", run)
    command.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    add_changes(command)


def run(args: argparse.Namespace) -> None:
    scene = changed_scene(args)
    print(as_json(scene.to_dict()) if args.json else scene_text(scene), end="")
