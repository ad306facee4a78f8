"""The time integration methods, with their cost and their stable steps (`region` has the theory)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..base.table import ReadOnly, aligned
from ..errors import OrderWarning, warn_caller
from .data import METHODS
from .region import axis_limit

if TYPE_CHECKING:
    from ..model.scene import Scene


@dataclass(frozen=True, repr=False)
class Integrator:
    """One time integration method.

    Attributes
    ----------
    name : str
        The name that `step`, `simulate` and `Stepper` take as ``integrator``.
    order, order_damped : int
        Power of the time step with which the error of a smooth motion falls, without and with damping; see `order_of`.
    symplectic : bool
        Whether the energy of an undamped scene stays bounded over any number of steps.
    description, source : str
        Purpose, and the source of the coefficients.
    family : str
        "runge_kutta" (explicit), "splitting" or "implicit".
    stages, stages_damped : int
        Force evaluations per step of a scene without and with damping.
    adaptive : bool
        Whether the method estimates its error, so that `simulate` can choose the step by it.
    """

    name: str
    order: int
    order_damped: int
    symplectic: bool
    description: str
    source: str
    family: str
    stages: int
    stages_damped: int
    adaptive: bool

    @property
    def explicit(self) -> bool:
        """False if a step solves a system of equations."""
        return self.family != "implicit"

    @property
    def damped(self) -> bool:
        """Whether the method keeps its order with damping forces, which depend on the velocity."""
        return self.order_damped == self.order

    @property
    def imaginary_limit(self) -> float:
        """Largest stable omega * dt of the undamped oscillator, to nine digits; 0 if every step amplifies it."""
        return axis_limit(self.name, damping=False)

    @property
    def real_limit(self) -> float:
        """Largest stable delta * dt of pure damping, to nine digits."""
        return axis_limit(self.name, damping=True)

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
    name: str, order: int, description: str, source: str, *, symplectic: bool = False, order_damped: int | None = None
) -> Integrator:
    data = METHODS[name]
    own = data.family, data.stages, data.stages_damped, data.adaptive
    return Integrator(name, order, order_damped or order, symplectic, description, source, *own)


_TABLE = (
    _record("rk4", 4, "classic Runge-Kutta, the paper's: the default", "Kutta, Z. Math. Phys. 46 (1901)"),
    _record(
        "explicit_euler",
        1,
        "drift and kick at once: amplifies undamped motion at every time step, to be seen beside the others",
        "Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd ed., eq I.7.3",
    ),
    _record(
        "semi_implicit_euler",
        1,
        "kick, then drift: what games use",
        "Hairer, Lubich, Wanner: Geometric Numerical Integration, eq I.1.9",
        symplectic=True,
    ),
    _record(
        "velocity_verlet",
        2,
        "kick, drift, kick; the second kick takes the velocity predicted by Euler's method, which "
        "keeps order 2 with damping, at two evaluations a step then",
        "Swope et al., J. Chem. Phys. 76 (1982) 637",
        symplectic=True,
    ),
    _record(
        "pefrl",
        4,
        "position-extended Forest-Ruth-like splitting: small error constant, for undamped scenes; of order 1 with damping",
        "Omelyan, Mryglod, Folk, Comput. Phys. Commun. 146 (2002) 188, eq 20",
        symplectic=True,
        order_damped=1,
    ),
    _record(
        "dopri5",
        5,
        "Dormand-Prince 5(4): errors of 1e-3 to 1e-7 of the size",
        "Dormand, Prince, J. Comput. Appl. Math. 6 (1980) 19",
    ),
    _record(
        "dop853",
        8,
        "Dormand-Prince 8(5,3): small errors at the least cost",
        "Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd ed., II.5, dop853.f",
    ),
    _record(
        "implicit_midpoint",
        2,
        "Newton's method with a sparse factorisation: stays bounded at huge steps, at the price of "
        "the error that order 2 has there",
        "Hairer, Lubich, Wanner: Geometric Numerical Integration, eq I.1.7",
        symplectic=True,
    ),
)


class _Integrators(ReadOnly[Integrator]):
    """The methods by name; it prints as a table."""

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("name", "order", "stages", "omega dt", "delta dt", "kind")]
        for one in self.values():
            stages, kind = one._traits
            limits = (f"{limit:.3f}" for limit in (one.imaginary_limit, one.real_limit))
            rows.append((one.name, str(one.order), stages, *limits, kind))
        return aligned((), rows, left=range(6))


_INTEGRATORS = _Integrators({method.name: method for method in _TABLE})


def integrators() -> Mapping[str, Integrator]:
    """The time integration methods by name, each an `Integrator`.

    Returns
    -------
    mapping of str to Integrator
        Read-only. It prints as a table.

    Examples
    --------
    >>> import clothsim as cs
    >>> for one in cs.integrators().values():
    ...     print(one.name, one.order, one.stages, one.explicit, round(one.imaginary_limit, 4))
    rk4 4 4 True 2.8284
    explicit_euler 1 1 True 0.0
    semi_implicit_euler 1 1 True 2.0
    velocity_verlet 2 1 True 2.0
    pefrl 4 4 True 2.9894
    dopri5 5 6 True 0.9972
    dop853 8 12 True 5.9604
    implicit_midpoint 2 1 False inf
    """
    return _INTEGRATORS


def warn_of_order(integrator: str, scene: Scene) -> bool:
    """Give an `OrderWarning` where damping lowers the order of this integrator; return True if it was given."""
    method = _INTEGRATORS[integrator]
    if lower := method.order_of(scene) < method.order:
        warn_caller(
            f"{integrator} is of order {method.order_damped} for a scene with damping, not of order "
            f"{method.order}: its errors are those of a method of order {method.order_damped}; take "
            "'rk4' or 'velocity_verlet', which keep their orders, or a cloth with damping=0",
            OrderWarning,
        )
    return lower
