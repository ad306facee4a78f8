"""The scene of a command: ready, hard case or file, with changes by `--set`."""

from __future__ import annotations

import argparse
import ast
import inspect
from collections.abc import Callable
from typing import Any

import clothsim as cs
from clothsim.model import fields

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
        changes[name] = _value(text)
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


def _value(text: str) -> Any:
    """A literal of Python, or the text itself."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
