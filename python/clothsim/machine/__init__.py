"""This machine: where numbers come from."""

from .origin import processor, provenance

__all__ = ["processor", "provenance"]
