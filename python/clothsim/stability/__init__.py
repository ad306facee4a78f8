"""Which time steps are stable: predicted from the spectrum, and measured."""

from typing import TYPE_CHECKING

from ..base.on_demand import on_demand as _on_demand

if TYPE_CHECKING:
    from .map import StabilityMap, measure_map

__all__ = ["StabilityMap", "measure_map"]

__getattr__, __dir__ = _on_demand(globals(), {"StabilityMap": ".map", "measure_map": ".map"})
del TYPE_CHECKING
