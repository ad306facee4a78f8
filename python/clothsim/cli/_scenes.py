"""The scene of a command: ready, hard case or file, with changes by options."""

from __future__ import annotations

import argparse
import difflib
import inspect
import math
from collections.abc import Callable
from typing import Any

import clothsim as cs
from clothsim.sweeps import fields

# Arguments of the scene that have an option of their own; `--set` takes every other name of `clothsim sweep`.
_CHANGES = ("shape", "size", "mass", "stiffness", "damping", "drag", "springs", "gravity")
_OF_SPHERES = ("radius", "response", "offset", "restitution", "friction")
_VECTORS = ("shape", "size", "gravity", "sphere_center", "sphere_velocity", "sphere_direction")
_MAY_BE_NONE = ("dt", "rtol", "atol", "sphere_restitution")
_BOOLEANS = ("strict", "sphere_as_printed")


def ready_scenes() -> dict[str, Callable[..., cs.Scene]]:
    """The functions of `clothsim.scenes` that return a scene, by name."""
    return {
        name: function
        for name, function in inspect.getmembers(cs.scenes, inspect.isfunction)
        if not name.startswith("_") and function.__annotations__.get("return") == "Scene"
    }


SCENE_HELP = f"a scene file (TOML), one of {', '.join(ready_scenes())}, or a hard case (clothsim stability --hard-cases)"


def scene_of(text: str, name: str = "SCENE") -> cs.Scene:
    """The scene of a file, the ready scene or the hard case of that name."""
    ready = ready_scenes()
    if text in ready:
        return ready[text]()
    if text.endswith(".toml"):
        return cs.load_scene(text)
    hard = cs.scenes.hard_cases()
    if text in hard:
        return hard[text].scene
    close = difflib.get_close_matches(text, [*ready, *hard], 1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise ValueError(
        f"{name} must be a file that ends in .toml, one of {', '.join(ready)}, or a hard case, got {text!r}{hint}"
    )


def add_changes(command: argparse.ArgumentParser) -> None:
    """Options that change the scene."""
    command.allow_abbrev = False
    group = command.add_argument_group(
        "changes of the scene", "A shape is ROWSxCOLUMNS or N, a vector X;Y;Z; families of springs have + between."
    )
    for option in (*_CHANGES, *_OF_SPHERES):
        name = f"sphere_{option}" if option in _OF_SPHERES else option
        if name in fields.NAMES:
            unit = fields.units(name)
            words = " ".join(
                part for part in (f"[{unit}]" * bool(unit), "of every sphere" * (option in _OF_SPHERES)) if part
            )
            group.add_argument(f"--{option}", metavar="VALUE", dest=f"change_{name}", help=words)
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any other name of `clothsim sweep --help`, such as sphere1_radius or stiffness_shear",
    )


def changed_scene(args: argparse.Namespace) -> cs.Scene:
    """The scene of the argument `scene`, with the changes of `add_changes`."""
    scene = scene_of(args.scene)
    values = named_values(args, "change_")
    if of_run := [name for name in values if name in (*fields.RUN, "scene")]:
        raise ValueError(f"--set must name an argument of the scene, got {of_run[0]!r}")
    return fields.change_scene(scene, {name: parsed(name, text) for name, text in values.items()})


def named_values(args: argparse.Namespace, prefix: str) -> dict[str, str]:
    """The texts of the options whose destinations have this prefix, and of `--set NAME=VALUE`, by name."""
    given = {name.removeprefix(prefix): text for name, text in vars(args).items() if name.startswith(prefix)}
    named = {name: text for name, text in given.items() if text is not None}
    for entry in args.set:
        name, sign, text = entry.partition("=")
        if not sign:
            raise ValueError(f"--set must be NAME=VALUE, got {entry!r}")
        named[fields.check_name(name)] = text
    return named


def option(name: str) -> str:
    """The option of `clothsim sweep` for a name."""
    return "--" + name.replace("_", "-")


def parsed(name: str, item: str) -> Any:
    """The value that a text gives for a name of `clothsim sweep`.

    Examples
    --------
    >>> parsed("shape", "32x16"), parsed("sphere_response", "ray"), parsed("gravity", "0;-9.8;0")
    ((32, 16), 'ray', (0.0, -9.8, 0.0))
    """
    if name in _BOOLEANS:
        if item not in ("true", "false"):
            raise ValueError(f"{option(name)} must be true or false, got {item!r}")
        return item == "true"
    if name == "springs":
        return tuple(item.split("+"))
    if name in _VECTORS:
        separator, kind = ("x", int) if name == "shape" else (";", float)
        try:
            if name == "shape" and item.isdigit():
                return (int(item), int(item))
            return tuple(kind(part) for part in item.split(separator))
        except ValueError:
            example = "32x32" if name == "shape" else "0;-9.8;0"
            raise ValueError(f"{option(name)} must be like {example}, got {item!r}") from None
    if name in _MAY_BE_NONE and item == "none":
        return None
    try:
        return float(item)
    except ValueError:
        return item


def parsed_range(name: str, item: str) -> list[float]:
    """The values of first:last:log9 or first:last:lin9.

    Examples
    --------
    >>> parsed_range("stiffness", "1e3:1e5:log3")
    [1000.0, 10000.0, 100000.0]
    """
    try:
        first, last, kind = item.split(":")
        rule, number = kind[:3], kind[3:]
        low, high, steps = float(first), float(last), int(number)
    except ValueError:
        rule = ""
    if rule not in ("log", "lin") or steps < 2 or (rule == "log" and min(low, high) <= 0):
        raise ValueError(f"{option(name)}: a range must be first:last:log9 (both > 0) or first:last:lin9, got {item!r}")
    middle = range(1, steps - 1)
    if rule == "lin":
        return [low, *(low + (high - low) * k / (steps - 1) for k in middle), high]
    a, b = math.log10(low), math.log10(high)
    # Rounded, so that a range over decades has 1e4 in it and not 9999.999999999998.
    return [low, *(float(f"{10 ** (a + (b - a) * k / (steps - 1)):.12g}") for k in middle), high]
