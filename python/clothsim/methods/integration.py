"""The time integration methods, with their cost and their stable steps.

The damped oscillator, one mode of a cloth near rest, decides stability. Its angular frequency omega
[1/s] is the root of an eigenvalue of the stiffness per unit mass. Its damping rate delta [1/s] is
an eigenvalue of the damping per unit mass:

    x'' = - omega^2 x - delta x'

A step of dt maps (x, dt v) linearly: by the matrix that `amplification.amplification_matrix` gives as a function
of omega dt and delta dt. The step is stable where no eigenvalue of it is larger than 1 in size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..base import check
from ..base.keywords import suggests
from ..base.table import aligned
from ..errors import OrderWarning, warn_caller

if TYPE_CHECKING:
    from ..model.scene import Scene

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Integrator:
    """One time integration method.

    Attributes
    ----------
    name : str
        The name that `step`, `simulate` and `Stepper` take as ``integrator``.
    order, order_damped : int
        Power of the time step with which the error of a smooth motion falls, without and with damping; see `order_of`.
    stages : int
        Force evaluations per step of an undamped scene; see `evaluations_per_step`.
    stages_damped : int
        Force evaluations per step of a scene with damping.
    explicit : bool
        False if a step solves a system of equations.
    adaptive : bool
        Whether the method estimates its error, so that `simulate` can choose the step by it. With a given time step,
        the method runs at that step.
    symplectic : bool
        Whether the energy of an undamped scene stays bounded over any number of steps.
    damped : bool
        Whether the method keeps its order with damping forces, which depend on the velocity.
    imaginary_limit : float
        Largest stable omega * dt of the undamped oscillator.
    real_limit : float
        Largest stable delta * dt of pure damping.
    description, source : str
        Purpose, and the source of the coefficients.
    """

    name: str
    order: int
    order_damped: int
    stages: int
    stages_damped: int
    explicit: bool
    adaptive: bool
    symplectic: bool
    damped: bool
    imaginary_limit: float
    real_limit: float
    description: str
    source: str

    def order_of(self, scene: Scene) -> int:
        """The order with which the error of this scene falls: `order_damped` if it is damped.

        Examples
        --------
        >>> import clothsim as cs
        >>> pefrl = cs.integrators()["pefrl"]
        >>> [pefrl.order_of(cs.scenes.oscillator(damping=c)) for c in (0.0, 0.1)]
        [4, 1]
        """
        return self.order_damped if scene.cloth.damped else self.order

    def evaluations_per_step(self, damped: bool) -> int:
        """Force evaluations per step of a scene with or without damping."""
        return self.stages_damped if damped else self.stages

    def __repr__(self) -> str:
        stages, kind = self._traits
        return f"<Integrator {self.name}: order {self.order}, stages {stages}, {kind}>"

    @property
    def _traits(self) -> tuple[str, ...]:
        """The properties as printed text."""
        order = "" if self.damped else " (damped: order 1)"
        damped = "" if self.stages_damped == self.stages else f" (damped: {self.stages_damped})"
        return (
            f"{self.stages}{damped}",
            ("explicit" if self.explicit else "implicit")
            + ", adaptive" * self.adaptive
            + ", symplectic" * self.symplectic
            + order,
        )


def _record(
    name: str,
    order: int,
    stages: int,
    imaginary_limit: float,
    real_limit: float,
    description: str,
    source: str,
    *,
    stages_damped: int | None = None,
    explicit: bool = True,
    adaptive: bool = False,
    symplectic: bool = False,
    order_damped: int | None = None,
) -> Integrator:
    damped = order_damped is None
    return Integrator(
        name,
        order,
        order_damped or order,
        stages,
        stages_damped or stages,
        explicit,
        adaptive,
        symplectic,
        damped,
        imaginary_limit,
        real_limit,
        description,
        source,
    )


_TABLE = (
    _record(
        "rk4",
        4,
        4,
        2.8284271247461903,
        2.7852935634052816,
        "classic Runge-Kutta, the paper's: the default",
        "Kutta, Z. Math. Phys. 46 (1901)",
    ),
    _record(
        "semi_implicit_euler",
        1,
        1,
        2.0,
        2.0,
        "kick, then drift: what games use",
        "Hairer, Lubich, Wanner: Geometric Numerical Integration, eq I.1.9",
        symplectic=True,
    ),
    _record(
        "velocity_verlet",
        2,
        1,
        2.0,
        2.0,
        "kick, drift, kick; the second kick takes the velocity predicted by Euler's method, which "
        "keeps order 2 with damping, at two evaluations a step then",
        "Swope et al., J. Chem. Phys. 76 (1982) 637",
        stages_damped=2,
        symplectic=True,
    ),
    _record(
        "pefrl",
        4,
        4,
        2.9894,
        2.3414,
        "position-extended Forest-Ruth-like splitting: small error constant, for undamped scenes; of order 1 with damping",
        "Omelyan, Mryglod, Folk, Comput. Phys. Commun. 146 (2002) 188, eq 20",
        symplectic=True,
        order_damped=1,
    ),
    _record(
        "dopri5",
        5,
        6,
        0.9971,
        3.3065,
        "Dormand-Prince 5(4): errors of 1e-3 to 1e-7 of the size",
        "Dormand, Prince, J. Comput. Appl. Math. 6 (1980) 19",
        adaptive=True,
    ),
    _record(
        "dop853",
        8,
        12,
        5.9603,
        6.3936,
        "Dormand-Prince 8(5,3): small errors at the least cost",
        "Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd ed., II.5, dop853.f",
        adaptive=True,
    ),
    _record(
        "implicit_midpoint",
        2,
        1,
        math.inf,
        math.inf,
        "Newton's method with a sparse factorisation: stays bounded at huge steps, at the price of "
        "the error that order 2 has there",
        "Hairer, Lubich, Wanner: Geometric Numerical Integration, eq I.1.7",
        explicit=False,
        symplectic=True,
    ),
)


class _Integrators(Mapping[str, Integrator]):
    """The methods by name; it prints as a table."""

    def __init__(self, methods: tuple[Integrator, ...]) -> None:
        self._methods = {method.name: method for method in methods}

    def __getitem__(self, name: str) -> Integrator:
        return self._methods[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._methods)

    def __len__(self) -> int:
        return len(self._methods)

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("name", "order", "stages", "omega dt", "delta dt", "kind")]
        for one in self.values():
            stages, kind = one._traits
            limits = (f"{limit:.3f}" for limit in (one.imaginary_limit, one.real_limit))
            rows.append((one.name, str(one.order), stages, *limits, kind))
        return aligned((), rows, left=range(6))


_INTEGRATORS: Mapping[str, Integrator] = _Integrators(_TABLE)

ALIASES: Mapping[str, str] = {
    "runge_kutta": "rk4",
    "runge_kutta_4": "rk4",
    "euler": "semi_implicit_euler",
    "symplectic_euler": "semi_implicit_euler",
    "verlet": "velocity_verlet",
    "leapfrog": "velocity_verlet",
    "forest_ruth": "pefrl",
    "rk45": "dopri5",
    "dormand_prince": "dopri5",
    "dop8": "dop853",
    "midpoint": "implicit_midpoint",
}
"""Further names of the methods, as other packages and books have them."""


def integrator_name(name: Any, *more: str, argument: str = "integrator") -> str:
    """The name of a method in the spelling of `integrators`.

    Case, "_", "-" and spaces do not count, and `ALIASES` are accepted.

    Parameters
    ----------
    name : str
    *more : str
        Further accepted names, such as "auto".
    argument : str, default "integrator"
        Name of the argument in error messages.

    Returns
    -------
    str

    Raises
    ------
    ValueError, TypeError
        If `name` is no such name; the message suggests the nearest.

    Examples
    --------
    >>> from clothsim.methods.integration import integrator_name
    >>> integrator_name("RK4"), integrator_name("RK45"), integrator_name("semi-implicit Euler")
    ('rk4', 'dopri5', 'semi_implicit_euler')
    """
    if isinstance(name, str):
        if name in _INTEGRATORS or name in more:
            return str(name)
        plain = "_".join(name.lower().replace("-", " ").replace("_", " ").split())
        plain = ALIASES.get(plain, plain)
        if plain in _INTEGRATORS or plain in more:
            return plain
    return check.choice(argument, name, (*more, *_INTEGRATORS))


@suggests
def integrators() -> Mapping[str, Integrator]:
    """The time integration methods by name, each an `Integrator`.

    Returns
    -------
    mapping of str to Integrator
        Read-only, in the order in which they are documented. It prints as a table.

    Examples
    --------
    >>> import clothsim as cs
    >>> for one in cs.integrators().values():
    ...     print(one.name, one.order, one.stages, one.explicit, one.imaginary_limit)
    rk4 4 4 True 2.8284271247461903
    semi_implicit_euler 1 1 True 2.0
    velocity_verlet 2 1 True 2.0
    pefrl 4 4 True 2.9894
    dopri5 5 6 True 0.9971
    dop853 8 12 True 5.9603
    implicit_midpoint 2 1 False inf
    """
    return _INTEGRATORS


def warn_of_order(integrator: str, scene: Scene) -> bool:
    """Give an `OrderWarning` where damping lowers the order of this integrator; return True if it was given."""
    method = _INTEGRATORS[integrator]
    lower = method.order_of(scene) < method.order
    if lower:
        warn_caller(
            f"{integrator} is of order {method.order_damped} for a scene with damping, not of order "
            f"{method.order}: its errors are those of a method of order {method.order_damped}; take "
            "'rk4' or 'velocity_verlet', which keep their orders, or a cloth with damping=0",
            OrderWarning,
        )
    return lower


_FACTS = {name: _core.method_facts(name) for name in _INTEGRATORS}

UPDATES: dict[str, tuple[int, int]] = {name: facts["updates"] for name, facts in _FACTS.items() if "updates" in facts}
"""Vectors times a number, added to a vector, in a step of each explicit method but RK4, without and with damping. The
velocity in x counts one, and each weight that is not 0 counts one."""

SPLITTINGS = {
    name: (facts["splitting"][0], [*facts["splitting"][1], 0.0]) for name, facts in _FACTS.items() if "splitting" in facts
}
"""As many drifts and kicks of each splitting, in turn, as parts of the step."""


def _further_terms(tableau: list[list[float]], order: int, stages: int) -> tuple[float, ...]:
    """Of exp(z) = sum z^k / k! a Runge-Kutta method keeps the terms up to its order and has these further ones.

    The k-th is b A^(k-1) 1 with the tableau (A, b). In long double, as the terms of dop853 cancel.
    """
    whole = np.array(tableau, np.longdouble)
    a, row = whole[:stages, :stages], whole[stages, :stages]
    terms = []
    for k in range(1, stages + 1):
        if k > order:
            terms.append(float(row.sum()))
        row = row @ a
    return tuple(terms)


FURTHER_TERMS = {
    "rk4": (),
    **{
        name: _further_terms(facts["tableau"], _INTEGRATORS[name].order, _INTEGRATORS[name].stages)
        for name, facts in _FACTS.items()
        if "tableau" in facts
    },
}
"""Of each Runge-Kutta method."""
