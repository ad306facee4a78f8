"""Rooms of the package: names occur once, public names are the ones listed."""

from collections import Counter
from importlib import import_module
from pathlib import Path

import clothsim as cs

PACKAGE = Path(cs.__file__).parent
MODULES = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")]


def test_a_module_name_occurs_once():
    counts = Counter(path.stem for path in MODULES if path.name != "__init__.py")
    assert [name for name, count in counts.items() if count > 1] == []


def test_dir_shows_public_names_only():
    shown = {name for name in dir(cs) if not name.startswith("__")}
    assert shown == {*cs.__all__, "errors", "typing"}
    assert not [name for name in ("TYPE_CHECKING", "growth", "carried", "on_demand") if hasattr(cs, name)]
    assert all(hasattr(cs, name) for name in shown)


def test_no_room_is_hidden_behind_a_function():
    rooms = [path.parent.name for path in MODULES if path.name == "__init__.py" and len(path.parts) == 2]
    assert len(rooms) > 10
    for room in rooms:
        assert getattr(import_module("clothsim"), room, None) in (None, import_module(f"clothsim.{room}"))
