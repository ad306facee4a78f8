"""This machine: where numbers come from."""

from ..base.on_demand import on_demand as _on_demand
from .origin import processor, provenance

__all__ = ["processor", "provenance"]

__getattr__, __dir__ = _on_demand(globals(), {})
