"""Names, families and coefficients of the time integration methods, as the core has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..base import check

Weights = tuple[float, list[float], list[float]]


@dataclass(frozen=True)
class MethodData:
    """A method as data."""

    family: str  # "runge_kutta", "splitting" or "implicit"
    in_kernels: bool  # whether the kernels take whole steps
    adaptive: bool
    stages: int  # force evaluations per step without damping
    stages_damped: int  # and with damping
    terms: tuple[float, ...]  # Runge-Kutta: factors of the powers of z, from 1 on, by which a step multiplies exp(z)
    splitting: tuple[list[float], list[float]]  # as many drifts and kicks, in turn, as parts of the step
    # The explicit method that replaces a splitting where there is damping. For each stage and for the result: factors of
    # the velocity in x, and of the accelerations in x and in v.
    damped: tuple[Weights, ...]


def _terms(tableau: list[list[float]], order: int, stages: int) -> tuple[float, ...]:
    """The stability polynomial. Up to the order it is that of exp(z); the further terms are b A^(k-1) 1.

    In long double, as the terms of dop853 cancel.
    """
    whole = np.array(tableau, np.longdouble)
    a, row = whole[:stages, :stages], whole[stages, :stages]
    terms, factorial = [1.0], 1
    for k in range(1, stages + 1):
        factorial *= k
        terms.append(1 / factorial if k <= order else float(row.sum()))
        row = row @ a
    return tuple(terms)


def method_data(facts: dict[str, Any]) -> MethodData:
    """The data of a method that the core has described."""
    drifts, kicks = facts.get("splitting", ((), ()))
    tableau = facts.get("tableau")
    terms = _terms(tableau, facts["order"], facts["stages"]) if tableau else ()
    same = {name: facts[name] for name in ("family", "in_kernels", "adaptive", "stages", "stages_damped")}
    return MethodData(**same, terms=terms, splitting=(list(drifts), [*kicks, 0.0]), damped=tuple(facts.get("damped", ())))


METHODS: Mapping[str, MethodData] = {name: method_data(facts) for name, facts in _core.methods().items()}
"""The data of each method by name, in the order in which the methods are documented."""

ALIASES: Mapping[str, str] = {
    "runge_kutta": "rk4",
    "runge_kutta_4": "rk4",
    "forward_euler": "explicit_euler",
    "symplectic_euler": "semi_implicit_euler",
    "verlet": "velocity_verlet",
    "leapfrog": "velocity_verlet",
    "rk45": "dopri5",
    "dormand_prince": "dopri5",
    "dop8": "dop853",
}
"""Further names of the same methods, as other packages and books have them."""


def integrator_name(name: Any, *more: str, argument: str = "integrator") -> str:
    """The name of a method in the spelling of `integrators`, or one of `more`, such as "auto".

    Case, "_", "-" and spaces do not count, and `ALIASES` are accepted. The error for another name has the name of the
    `argument`, and suggests the nearest.

    >>> integrator_name("RK4"), integrator_name("RK45"), integrator_name("semi-implicit Euler")
    ('rk4', 'dopri5', 'semi_implicit_euler')
    """
    if isinstance(name, str):
        if name in METHODS or name in more:
            return str(name)
        plain = "_".join(name.lower().replace("-", " ").replace("_", " ").split())
        plain = ALIASES.get(plain, plain)
        if plain in METHODS or plain in more:
            return plain
    return check.choice(argument, name, (*more, *METHODS))
