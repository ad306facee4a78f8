"""The time integration methods as data: properties and coefficients, which the core has. `region`
has their theory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..base import check
from ..base.text import align_table
from ..errors import OrderWarning, warn_caller

if TYPE_CHECKING:
    from ..model.scene import Scene

Weights = tuple[float, list[float], list[float]]


@dataclass(frozen=True)
class Integrator:
    """One time integration method.

    Attributes
    ----------
    name : str
        The name that `step`, `simulate` and `Stepper` take as ``integrator``.
    order, order_damped : int
        Power of the time step with which the error of a smooth motion falls, without and with
        damping; see `order_of`.
    symplectic : bool
        Whether the energy of an undamped scene stays bounded over any number of steps.
    family : str
        "runge_kutta" (explicit), "splitting", "stabilised" (explicit too) or "implicit".
    adaptive : bool
        Whether the method estimates its error, so that `simulate` can choose the step by it.
    stages, stages_damped : int
        Force evaluations per step of a scene without and with damping; of "rkc2" the least, as the
        damping of the scene asks for.
    """

    name: str
    order: int
    order_damped: int
    symplectic: bool
    family: str
    adaptive: bool
    stages: int
    stages_damped: int
    in_kernels: bool = field(repr=False)  # whether the kernels take whole steps
    # Runge-Kutta: factors of the powers of z, from 1 on, by which a step multiplies exp(z).
    terms: tuple[float, ...] = field(repr=False)
    # A splitting has as many drifts as kicks, which take turns, in parts of the step.
    splitting: tuple[list[float], list[float]] = field(repr=False)
    # The explicit method that replaces a splitting where there is damping. For each stage and for
    # the result: factors of the velocity in x, and of the accelerations in x and in v.
    weights_damped: tuple[Weights, ...] = field(repr=False)

    @property
    def explicit(self) -> bool:
        """False if a step solves a system of equations."""
        return self.family != "implicit"

    @property
    def fixed(self) -> bool:
        """Whether the method also takes steps of a given `dt`."""
        return self.family != "stabilised"

    @property
    def damped(self) -> bool:
        """Whether the method keeps its order with damping forces, which depend on the velocity."""
        return self.order_damped == self.order

    @property
    def imaginary_limit(self) -> float:
        """Largest stable omega * dt of the undamped oscillator, to nine digits; 0 if every step
        amplifies it.
        """
        from .region import limit_on_axis

        return limit_on_axis(self.name, damping=False)

    @property
    def real_limit(self) -> float:
        """Largest stable delta * dt of pure damping, to nine digits."""
        from .region import limit_on_axis

        return limit_on_axis(self.name, damping=True)

    def order_of(self, scene: Scene) -> int:
        """Return the order with which the error of this scene falls: `order_damped` if it is
        damped.

        Examples
        --------
        >>> pefrl = cs.integrators()["pefrl"]
        >>> [pefrl.order_of(cs.scenes.oscillator(damping=c)) for c in (0.0, 0.1)]
        [4, 1]
        """
        return self.order_damped if scene.damped else self.order

    @property
    def _stages_and_kind_text(self) -> tuple[str, str]:
        """Stages and kind as text."""
        if not self.fixed:
            return f"{self.stages} or more", "explicit, adaptive alone, stabilised"
        damped = "" if self.stages_damped == self.stages else f" (damped: {self.stages_damped})"
        kind = "explicit" if self.explicit else "implicit"
        order = "" if self.damped else f" (damped: order {self.order_damped})"
        return (
            f"{self.stages}{damped}",
            kind + ", adaptive" * self.adaptive + ", symplectic" * self.symplectic + order,
        )


# Order, order with damping, and whether the method is symplectic.
_PROPERTIES = {
    "rk4": (4, 4, False),
    "explicit_euler": (1, 1, False),
    "semi_implicit_euler": (1, 1, True),
    "velocity_verlet": (2, 2, True),
    "pefrl": (4, 1, True),
    "dopri5": (5, 5, False),
    "dop853": (8, 8, False),
    "rkc2": (2, 2, False),
    "implicit_midpoint": (2, 2, True),
}


def _stability_polynomial(tableau: list[list[float]], order: int, stages: int) -> tuple[float, ...]:
    """Return the stability polynomial. Up to the order it is that of exp(z); the further terms are
    b A^(k-1) 1.

    In long double, as the terms of dop853 cancel.
    """
    weights = np.array(tableau, np.longdouble)
    a = weights[:stages, :stages]
    row = weights[stages, :stages]
    terms = [1.0]
    factorial = 1
    for k in range(1, stages + 1):
        factorial *= k
        terms.append(1 / factorial if k <= order else float(row.sum()))
        row = row @ a
    return tuple(terms)


def _make_integrator(name: str, facts: dict[str, Any]) -> Integrator:
    """Return a method that the core has described."""
    drifts, kicks = facts.get("splitting", ((), ()))
    tableau = facts.get("tableau")
    order, order_damped, symplectic = _PROPERTIES[name]
    return Integrator(
        name=name,
        order=order,
        order_damped=order_damped,
        symplectic=symplectic,
        **{
            key: facts[key]
            for key in ("family", "adaptive", "stages", "stages_damped", "in_kernels")
        },
        terms=_stability_polynomial(tableau, facts["order"], facts["stages"]) if tableau else (),
        splitting=(list(drifts), [*kicks, 0.0]),
        weights_damped=tuple(facts.get("damped", ())),
    )


class _Integrators(dict[str, Integrator]):
    """The methods by name; it prints as a table."""

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("name", "order", "stages", "omega dt", "delta dt", "kind")]
        for method in self.values():
            stages, kind = method._stages_and_kind_text
            limits = (f"{limit:.3f}" for limit in (method.imaginary_limit, method.real_limit))
            rows.append((method.name, str(method.order), stages, *limits, kind))
        return align_table(rows, left=range(6))


METHODS = _Integrators(
    {name: _make_integrator(name, facts) for name, facts in _core.methods().items()}
)
"""Each method by name, in the order in which the methods are documented."""


def integrators() -> Mapping[str, Integrator]:
    """Return the time integration methods by name, each an `Integrator`.

    Returns
    -------
    mapping of str to Integrator
        It prints as a table.

    Examples
    --------
    >>> for method in cs.integrators().values():
    ...     print(method.name, method.order, method.stages, round(method.imaginary_limit, 4))
    rk4 4 4 2.8284
    explicit_euler 1 1 0.0
    semi_implicit_euler 1 1 2.0
    velocity_verlet 2 1 2.0
    pefrl 4 4 2.9894
    dopri5 5 6 0.9972
    dop853 8 12 5.9604
    rkc2 2 2 0.0
    implicit_midpoint 2 1 inf
    """
    return _Integrators(METHODS)


def check_integrator_name(
    name: Any, *more: str, argument: str = "integrator", fixed: bool = False
) -> str:
    """Return `name` if it is the name of a method, or one of `more`, such as "auto".

    `fixed`: steps of a given length are asked for, which some methods do not take.
    """
    method = str(check.choice(argument, name, (*more, *METHODS)))
    if fixed and method not in more and METHODS[method].family == "stabilised":
        raise ValueError(
            f"{argument} must be another than {method!r} here, which takes no steps of a given "
            "length, as its stages follow from the damping: give simulate rtol or atol and no "
            "dt, or take 'rk4'"
        )
    return method


def warn_of_order(integrator: str, scene: Scene) -> bool:
    """Give an `OrderWarning` where damping lowers the order of this integrator; return True if it
    was given.
    """
    method = METHODS[integrator]
    if lower := method.order_damped < method.order and scene.damped:
        warn_caller(
            f"{integrator} is of order {method.order_damped} for a scene with damping, not of "
            f"order {method.order}: its errors are those of a method of order "
            f"{method.order_damped}; take "
            "'rk4' or 'velocity_verlet', which keep their orders, or a cloth with damping=0",
            OrderWarning,
        )
    return lower
