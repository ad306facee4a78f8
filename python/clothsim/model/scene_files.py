"""Scenes as TOML files that people read and write; `Scene.to_dict` gives their layout."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base import check, files
from ..base.extras import import_from_extra
from .fields import unit_of_name
from .scene import Scene

_END = "file"  # the last table; its only entry shows that the file has not been cut

# The comment of every other argument is its unit.
_COMMENTS = {
    "schema": "version of this layout",
    "position": "m, one [x, y, z] per mass point of every row; without it: the flat sheet",
    "force": "N, one [x, y, z] per mass point of every row",
    "shape": "rows, columns",
    "size": "m, along the rows and along the columns",
    "mass": "kg in all, or per mass point",
    "stiffness": "N/m, one number or one per family",
    "damping": "N s/m along each spring, one number or one per family",
    "drag": "N s/m, of each point's velocity",
    "pins": "row, column; negative ones count from the end",
    "points": "row, column",
    "response": "what a contact does",
    "offset": "a rule, or m",
    "point": "m, a place on a plane",
    "wind": "moving air",
    "offsets": "m, from the start",
}


@check.check_names
def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a TOML file.

    The file has "schema" (2), a table "cloth", tables "spheres" and the other arguments of `Scene`.
    Missing arguments take their defaults. The last line, ``complete = true`` of the table "file",
    shows that nothing has been cut off. Comments and the order of keys and tables are free.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    ValueError, TypeError
        If the file is not TOML, is cut, has another schema version, an unknown key or a refused
        value.
    ImportError
        On Python 3.10 without tomli (the extra "sweep").

    Examples
    --------
    >>> import tempfile
    >>> scene = cs.scenes.paper_moving()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cs.load_scene(cs.save_scene(scene, folder + "/moving.toml")) == scene
    True
    """
    path = check.path("path", path)
    toml = import_from_extra("tomllib" if sys.version_info >= (3, 11) else "tomli", "a scene file")
    content = path.read_bytes()
    try:
        data = toml.loads(content.decode("utf-8-sig"))
        if data.pop(_END, None) != {"complete": True}:
            raise ValueError(
                f"it is cut: its end, the lines '[{_END}]' and 'complete = true', is missing"
            )
        return Scene.from_dict(data)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"{path} is no TOML file of a scene: {error}") from None


@check.check_names
def save_scene(scene: Scene, path: str | os.PathLike[str]) -> Path:
    """Write a scene to a TOML file that `load_scene` reads back as an equal scene, and return its
    path.

    Every argument is written, with its unit as a comment, so that you can edit the file without the
    documentation.

    Parameters
    ----------
    scene : Scene
    path : path-like
        Replaced if it exists, once the new file is complete. A symbolic link is replaced, not
        followed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = cs.save_scene(cs.scenes.paper_static(), folder + "/static.toml")
    ...     text = path.read_text()
    >>> print(text.splitlines()[6])
    mass = 512.0  # kg in all, or per mass point
    """
    check.instance("scene", scene, Scene)
    return files.write_bytes(check.path("path", path), toml_text(scene.to_dict()).encode())


def toml_text(data: Mapping[str, Any]) -> str:
    """Return the TOML text of `Scene.to_dict`."""
    return "\n".join(_toml_lines({**data, _END: {"complete": True}}, "")) + "\n"


def _toml_lines(data: Mapping[str, Any], path: str) -> list[str]:
    """Return the lines of a table: its values, then the tables in it.

    TOML reads a value after a table's heading as that table's, hence the order.
    """
    lines = []
    below = []
    for key, value in data.items():
        inner_path = f"{path}.{key}" if path else key
        # The short mappings of spring families are on the lines of their keys.
        if isinstance(value, Mapping) and inner_path not in ("cloth.stiffness", "cloth.damping"):
            below += ["", f"[{inner_path}]", *_toml_lines(value, inner_path)]
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for entry in value:
                below += ["", f"[[{inner_path}]]", *_toml_lines(entry, inner_path)]
        else:
            comment = _COMMENTS.get(key, unit_of_name(key))
            lines.append(
                f"{key} = {_toml_value(value)}" + (f"  # {comment}" if comment.strip("1") else "")
            )
    return lines + below


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a JSON string is a TOML basic string
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{key} = {_toml_value(entry)}" for key, entry in value.items()) + " }"
        )
    return "[" + ", ".join(map(_toml_value, value)) + "]"
