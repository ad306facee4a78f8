"""The term of the forces that limits the time step: stiffness or damping, with its spring families."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from .. import _core
from .region import box_limit

if TYPE_CHECKING:
    from ..model.scene import Scene

_TIE = 0.95  # families whose removal lowers the bound by this part of the most are named together


@dataclass(frozen=True)
class LimitingTerm:
    """The term that limits the guaranteed time step.

    Attributes
    ----------
    kind : {"stiffness", "damping", "nothing"}
    families : tuple of str
        The spring families of the term, or ("points",) for point damping.
    values : tuple of float
        The term's value for each family [N/m] or [N s/m].
    below : tuple of float
        The values below which the other kind limits the step, with all families reduced in proportion. 0 if there is no
        other kind.
    max_stable_dt : float
        The guaranteed time step [s].
    """

    kind: str
    families: tuple[str, ...]
    values: tuple[float, ...]
    below: tuple[float, ...]
    max_stable_dt: float

    @property
    def name(self) -> str:
        """Kind and families, such as "the damping of structural and shear springs"."""
        if self.kind == "nothing":
            return "nothing"
        *most, last = self.families
        springs = f"{', '.join(most)} and {last}" if most else last
        return f"the {self.kind} of {springs}{'' if last == 'points' else ' springs'}"

    def __str__(self) -> str:
        if self.kind == "nothing":
            return "nothing limits it"
        unit = "N/m" if self.kind == "stiffness" else "N s/m"

        def listed(numbers: tuple[float, ...]) -> str:
            different = dict.fromkeys(f"{one:.3g}" for one in numbers)
            return f"{' and '.join(different)} {unit}"

        text = f"{self.name}, {listed(self.values)}, limits it"
        return f"{text}; below {listed(self.below)} it would not" if any(self.below) else text


def limiting_term(scene: Scene, integrator: str) -> LimitingTerm:
    """The term that limits the step that `max_stable_dt` guarantees for a scene."""
    cloth = scene.cloth
    families = cloth.families
    return _limiting_term(
        cloth.shape,
        cloth.spacing,
        tuple(cloth.family_stiffness[f] for f in families),
        tuple(cloth.family_damping[f] for f in families),
        families,
        cloth.point_damping,
        cloth.uniform_mass,
        cloth.mass_per_point.tobytes(),
        cloth.pinned.tobytes(),
        integrator,
    )


def _without(values: dict[str, float], family: str) -> dict[str, float]:
    return {**values, family: 0.0}


@lru_cache(maxsize=64)
def _limiting_term(
    shape: tuple[int, int],
    spacing: tuple[float, float],
    stiffness: tuple[float, ...],
    damping: tuple[float, ...],
    families: tuple[str, ...],
    point_damping: float,
    uniform_mass: bool,
    mass: bytes,
    pinned: bytes,
    integrator: str,
) -> LimitingTerm:
    import numpy as np

    masses = np.frombuffer(mass).reshape(shape)
    pins = np.frombuffer(pinned, bool).reshape(shape)

    def bounds(k: dict[str, float], c: dict[str, float], point: float) -> tuple[float, float]:
        omega2, delta = _core.Cloth(
            rows=shape[0],
            columns=shape[1],
            row_spacing=spacing[0],
            column_spacing=spacing[1],
            stiffness=k,
            spring_damping=c,
            point_damping=point,
            mass=masses,
            uniform_mass=uniform_mass,
            pinned=pins,
        ).mode_bounds
        return math.sqrt(omega2), delta

    k, c = dict(zip(families, stiffness)), dict(zip(families, damping))
    omega, delta = bounds(k, c, point_damping)
    limit = box_limit(integrator, omega, delta)
    alone = box_limit(integrator, omega, 0.0), box_limit(integrator, 0.0, delta)
    if not math.isfinite(limit):
        return LimitingTerm("nothing", (), (), (), limit)
    if alone[1] < alone[0]:
        kind, values, factor = "damping", c, alone[1] / alone[0]
        left = {f: bounds(k, _without(c, f), point_damping)[1] for f in families}
        left["points"] = bounds(k, c, 0.0)[1]
        values = {**c, "points": point_damping}
        whole = delta
    else:
        kind, values, factor = "stiffness", k, (alone[0] / alone[1]) ** 2
        left = {f: bounds(_without(k, f), c, point_damping)[0] for f in families}
        whole = omega
    fall = {f: whole - rest for f, rest in left.items()}
    named = tuple(f for f in fall if fall[f] >= _TIE * max(fall.values()))
    return LimitingTerm(kind, named, tuple(values[f] for f in named), tuple(factor * values[f] for f in named), limit)
