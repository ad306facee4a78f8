"""Scenes that strain the method or the arithmetic, each with the outcome to expect."""

from __future__ import annotations

from .case import Figure, HardCase, HardCaseResult
from .cases import contact, geometry, masses, stiffness, time_steps

__all__ = ["Figure", "HardCase", "HardCaseResult", "hard_cases"]


def hard_cases() -> dict[str, HardCase]:
    """Scenes that strain the method or the arithmetic, each with the outcome to expect, by name.

    Stiffnesses of 1e6 to 1e12 N/m and of 1e7 beside 1 N/m; time steps right below and above the
    limit, of 5e-6 s in single, a million of them; springs without length, points that coincide, a
    collapsed cloth; a mass ratio of 1e6; strips of one row; 1e6 m from the origin;
    pins and points inside a sphere, and a sphere at 100 m/s. The tests
    run them all.

    Returns
    -------
    dict of str to clothsim.hard_cases.HardCase
        A case has `scene`, `dt`, `steps`, a text of the difficulty, the outcome `expected`, and `run`.

    Examples
    --------
    >>> import clothsim as cs
    >>> case = cs.scenes.hard_cases()["1e6 m away"]
    >>> case.expected
    'the motion at the origin, contact included'
    >>> result = case.run("single")
    >>> result.passed, len(result.figures)
    (True, 2)
    """
    families = (stiffness, time_steps, geometry, masses, contact)
    return {name: case for family in families for name, case in family().items()}
