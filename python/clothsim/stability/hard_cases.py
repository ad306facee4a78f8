"""The hard cases, family by family; `clothsim.scenes.hard_cases` names them all."""

from __future__ import annotations

from .hard_case import HardCase
from .hard_contact import contact
from .hard_forces import masses_and_speeds, stiffness, time_steps
from .hard_geometry import geometry


def hard_cases() -> dict[str, HardCase]:
    """All of them by name."""
    families = (stiffness, time_steps, geometry, masses_and_speeds, contact)
    return {name: case for family in families for name, case in family().items()}
