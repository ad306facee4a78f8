"""Scenes that strain the method or the arithmetic, each with judges of its end."""

from __future__ import annotations

from .case import Figure, HardCase, HardCaseResult
from .cases import contact, geometry, masses, stiffness, time_steps

__all__ = ["Figure", "HardCase", "HardCaseResult", "hard_cases"]


def hard_cases() -> dict[str, HardCase]:
    """Scenes that are difficult for the method or the arithmetic, each with checks of its final state, by name.

    Returns
    -------
    dict of str to clothsim.hard_cases.HardCase
        A case has `scene`, `dt`, `steps`, `why` (a text that explains the difficulty) and `run`.

    Examples
    --------
    >>> import clothsim as cs
    >>> case = cs.scenes.hard_cases()["1e6 m away"]
    >>> case.why
    'float32 tells points there apart by 6 cm'
    >>> result = case.run("single")
    >>> result.passed, len(result.figures)
    (True, 2)
    """
    families = (stiffness, time_steps, geometry, masses, contact)
    return {name: case for family in families for name, case in family().items()}
