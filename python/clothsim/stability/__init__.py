"""Which time steps are stable: guaranteed, predicted from the spectrum, and measured."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .hard_case import Figure, HardCase, HardCaseResult
    from .map import StabilityMap, measure_map

_PLACES = {
    "Figure": "hard_case",
    "HardCase": "hard_case",
    "HardCaseResult": "hard_case",
    "StabilityMap": "map",
    "measure_map": "map",
}

__all__ = ["Figure", "HardCase", "HardCaseResult", "StabilityMap", "measure_map"]


def __getattr__(name: str) -> Any:
    # On demand: stepping needs `bound` from here, and these need stepping.
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_PLACES[name]}", __name__), name)
