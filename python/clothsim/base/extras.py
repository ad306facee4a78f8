"""Packages beyond NumPy, and slow modules of public names, imported when they are needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

EXTENSIONS: dict[str, str] = {}
"""Packages, and the module of ours that is imported after each, as it extends it; the package's
`__init__` fills the table.
"""


def import_from_extra(name: str, purpose: str, extra: str = "sweep") -> Any:
    """Import the named module, or raise an ImportError that says which extra brings it, or why it
    cannot be loaded.
    """
    package = name.partition(".")[0]
    if find_spec(package) is None:
        raise ImportError(f"{purpose} needs {package}: run pip install 'clothsim[{extra}]'")
    try:
        module = import_module(name)
    except ImportError as error:  # The package may lack memory, or a package of its own.
        raise ImportError(
            f"{purpose} needs {package}, which is installed but could not be loaded: {error}"
        ) from error
    if name in EXTENSIONS:
        import_module(EXTENSIONS[name])
    return module


def make_late_importers(
    namespace: dict[str, Any], modules: Mapping[str, Sequence[str]], also: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of the module with that namespace (PEP 562).

    `modules` has the names of each module, relative to the package. `dir` lists `__all__`, the
    names of Python itself and those in `also`.
    """
    package = namespace["__name__"]
    places = {name: module for module, names in modules.items() for name in names}

    def get_attribute(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = namespace[name] = getattr(import_module(places[name], package), name)
        return value

    names = {*namespace["__all__"], *also, *(name for name in namespace if name.startswith("__"))}
    return get_attribute, lambda: sorted(names)
