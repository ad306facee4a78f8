"""The guaranteed stable time step of a cloth, for all but extreme states (see `max_stable_dt`), and
what limits it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from .. import _core
from ..model.cloth import Cloth
from ..model.scene import Scene
from .region import box_limit

# A sweep asks for thousands of cloths of few kinds, and every call of `step` asks again.
_limit = lru_cache(maxsize=4096)(box_limit)


def guaranteed_dt(cloth: _core.Cloth, integrator: str) -> float:
    """The guarantee that `clothsim.max_stable_dt` gives without a state [s]."""
    stiffness, damping = cloth.mode_bounds
    return _limit(integrator, math.sqrt(stiffness), damping)


def usable_dt(cloth: _core.Cloth, integrator: str) -> float:
    """`guaranteed_dt`, or a ValueError for a method that has no stable time step for this cloth."""
    limit = guaranteed_dt(cloth, integrator)
    if limit == 0:
        raise ValueError(
            f"dt must be given with integrator {integrator!r}, which has no stable time step for "
            "this scene: it amplifies undamped motion at every time step; or take "
            "'semi_implicit_euler' or 'rk4'"
        )
    return limit


def stable_dt(scene: Scene, integrator: str = "rk4") -> float:
    """The guaranteed time step of a scene [s]."""
    return guaranteed_dt(scene.cloth.core, integrator)


def limit_in_layer(scene: Scene, integrator: str, k: int, depth: float) -> float:
    """Return the guaranteed time step with mass points so deep [m] in the layer of an obstacle [s].

    Bounds at depth d: stiffness 6 k (d/h)^2, damping c F0 + 2 mu F0 / v_s, F0 = k d^3 / h^2, over
    the mass of the lightest free point, beside those of the springs.
    """
    thickness, bounds = _layer_bounds(scene, k)
    return _limit_at(integrator, bounds, depth / thickness)


def stable_depths(scene: Scene, integrator: str, dt: float) -> list[float]:
    """Return, for each obstacle, the depth in its layer up to which a time step is stable [m].

    It is infinite for responses after the step, and where the step is too long without contact.
    """
    depths = [math.inf] * len(scene.spheres)
    if dt <= stable_dt(scene, integrator):
        for k, obstacle in enumerate(scene.spheres):
            if obstacle.response == "penalty":
                thickness, bounds = _layer_bounds(scene, k)
                depths[k] = thickness * _stable_part(integrator, bounds, dt)
    return depths


class _LayerBounds(NamedTuple):
    """Bounds of the modes of a cloth, and what a point in a layer adds to them."""

    stiffness: float  # of the springs [1/s^2]
    damping: float  # of the springs and drag [1/s]
    square: float  # of the stiffness, times (d/h)^2 [1/s^2]
    cube: float  # of the damping, times (d/h)^3 [1/s]


def _layer_bounds(scene: Scene, k: int) -> tuple[float, _LayerBounds]:
    """Return the thickness of the layer of an obstacle [m], and the bounds in it."""
    obstacle, cloth = scene.spheres[k], scene.cloth
    layer = obstacle.layer(cloth)
    mass = float(cloth.mass_per_point.min(initial=math.inf, where=~cloth.pinned))
    thickness, stiffness = layer["thickness"], layer["stiffness"]
    damping = layer["dissipation"] + 2 * obstacle.friction / layer["slip_speed"]
    bounds = _LayerBounds(
        *cloth.core.mode_bounds,
        square=6 * stiffness / mass,
        cube=damping * stiffness * thickness / mass,
    )
    return thickness, bounds


def _limit_at(integrator: str, bounds: _LayerBounds, part: float) -> float:
    """Return the guaranteed time step at `part` of the thickness of a layer [s]."""
    stiffness = bounds.stiffness + bounds.square * part**2
    return box_limit(integrator, math.sqrt(stiffness), bounds.damping + bounds.cube * part**3)


_BISECTIONS = 12  # of a depth, to 5e-4 of the thickness


@lru_cache(maxsize=4096)
def _stable_part(integrator: str, bounds: _LayerBounds, dt: float) -> float:
    """Return the part of the thickness of a layer up to which a time step is stable."""
    low, high = 0.0, 2.0
    if _limit_at(integrator, bounds, high) >= dt:
        return math.inf
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if _limit_at(integrator, bounds, middle) >= dt:
            low = middle
        else:
            high = middle
    return low


_TIE = 0.95  # families whose removal lowers the bound by this part of the most are named together


@dataclass(frozen=True)
class LimitingTerm:
    """The term that limits the guaranteed time step."""

    # "stiffness", "damping", "nothing", or "method" where the integrator has no stable time step
    # for this cloth.
    kind: str
    families: tuple[str, ...]  # the spring families of the term, or "points" for drag
    values: tuple[float, ...]  # of the term, for each family [N/m] or [N s/m]
    # Where the other kind limits the step, all families reduced in proportion; 0 if there is none.
    below: tuple[float, ...]
    max_stable_dt: float  # the guaranteed time step [s]
    integrator: str

    def __str__(self) -> str:
        if self.kind == "nothing":
            return "nothing limits it"
        if self.kind == "method":
            return f"{self.integrator} amplifies undamped motion at every time step"
        *most, last = [f for f in self.families if f != "points"] or [""]
        springs = (
            [f"the {self.kind} of {', '.join(most)}{' and ' * bool(most)}{last} springs"]
            if last
            else []
        )
        name = " and ".join([*springs, *["the drag of points"] * ("points" in self.families)])
        other = "stiffness" if self.kind == "damping" else "damping"
        text = f"{name}, {self._listed(self.values)}, limits it"
        return (
            f"{text}; below {self._listed(self.below)} the {other} would"
            if any(self.below)
            else text
        )

    def _listed(self, numbers: tuple[float, ...]) -> str:
        different = dict.fromkeys(f"{one:.3g}" for one in numbers)
        return f"{' and '.join(different)} {'N/m' if self.kind == 'stiffness' else 'N s/m'}"


def limiting_term(scene: Scene, integrator: str) -> LimitingTerm:
    """The term that limits the step that `max_stable_dt` guarantees for a scene."""
    return _term_of(scene.cloth, integrator)


@lru_cache(maxsize=64)
def _term_of(cloth: Cloth, integrator: str) -> LimitingTerm:
    def bounds(**changes: Any) -> tuple[float, float]:
        omega2, delta = cloth.replace(**changes).core.mode_bounds
        return math.sqrt(omega2), delta

    k, c = cloth.family_stiffness, cloth.family_damping
    omega, delta = bounds()
    limit = box_limit(integrator, omega, delta)
    alone = box_limit(integrator, omega, 0.0), box_limit(integrator, 0.0, delta)
    if not math.isfinite(limit):
        return LimitingTerm("nothing", (), (), (), limit, integrator)
    if limit == 0:
        return LimitingTerm("method", (), (), (), limit, integrator)
    if alone[1] < alone[0]:
        kind, values, factor = "damping", c, alone[1] / alone[0]
        left = {f: bounds(damping={**c, f: 0.0})[1] for f in c}
        left["points"] = bounds(drag=0.0)[1]
        values = {**c, "points": cloth.drag}
        whole = delta
    else:
        kind, values, factor = "stiffness", k, (alone[0] / alone[1]) ** 2
        left = {f: bounds(stiffness={**k, f: 0.0})[0] for f in k}
        whole = omega
    fall = {f: whole - rest for f, rest in left.items()}
    named = tuple(f for f in fall if fall[f] >= _TIE * max(fall.values()))
    given = tuple(values[f] for f in named)
    return LimitingTerm(kind, named, given, tuple(factor * one for one in given), limit, integrator)
