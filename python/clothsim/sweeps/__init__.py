"""Sweeps: thousands of cloths, labelled, resumable, on one machine or a cluster."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

from ..base.on_demand import later


def register() -> None:
    """Register ``Dataset.clothsim``: now if xarray is imported, else at its import."""
    if sys.modules.get("xarray") is not None:
        later("sweeps.accessor")
    else:
        sys.meta_path.insert(0, _AfterXarray())


class _AfterXarray(MetaPathFinder):
    """Finds xarray by the other finders, and registers the accessor after its import."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "xarray":
            return None
        others = (finder for finder in sys.meta_path if not isinstance(finder, _AfterXarray))
        spec = next(filter(None, (finder.find_spec(name, path, target) for finder in others)), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    later("sweeps.accessor")

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
