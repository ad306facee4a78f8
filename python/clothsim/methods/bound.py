"""The stable time step of a cloth, guaranteed for all but extreme states (see `max_stable_dt`), and
what limits it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from .. import _core
from ..model.cloth import FAMILIES, Cloth
from ..model.scene import Scene
from .integrators import METHODS
from .region import stable_dt_of_box

# A sweep asks for thousands of cloths of few kinds, and every call of `step` asks again.
_limit = lru_cache(maxsize=4096)(stable_dt_of_box)


def stable_dt(scene: Scene, integrator: str = "rk4") -> float:
    """Return the stable time step that `clothsim.max_stable_dt` gives without a state [s]; that of
    rk4 for a method without steps of a given length.
    """
    if METHODS[integrator].family == "stabilised":
        integrator = "rk4"
    stiffness, damping = _core.mode_bounds(scene.cloth.core, scene.core_forces)
    return _limit(integrator, math.sqrt(stiffness), damping)


def stable_dt_ratio_without_damping(scene: Scene) -> float:
    """Return the stable step of rk4 without the damping of springs and drag over that with it."""
    cloth = scene.cloth.core
    drag = [force for force in scene.core_forces if force.name == "drag"]
    stiffness, damping = _core.mode_bounds(cloth, drag)
    omega = math.sqrt(stiffness)
    if damping == 0:
        return 1.0
    return _limit("rk4", omega, 0.0) / _limit("rk4", omega, damping)


# From these ratios on, damped cloths cost less by rkc2 than by dop853, down to these tolerances.
_DAMPED = ((20.0, 1e-6), (4.0, 1e-5))


def least_rtol_of_rkc2(scene: Scene) -> float:
    """Return the relative tolerance from which on "auto" takes rkc2; infinite where it does not.

    Responses after the step keep steps near them short, so that rkc2 gains nothing.
    """
    if any(obstacle.response != "penalty" for obstacle in scene.spheres):
        return math.inf
    ratio = stable_dt_ratio_without_damping(scene)
    return next((rtol for least, rtol in _DAMPED if ratio >= least), math.inf)


def stable_dt_or_error(scene: Scene, integrator: str) -> float:
    """Return `stable_dt`, or raise a ValueError for a method that has no stable time step for this
    scene.
    """
    limit = stable_dt(scene, integrator)
    if limit == 0:
        raise ValueError(
            f"dt must be given with integrator {integrator!r}, which has no stable time step for "
            "this scene: it amplifies undamped motion at every time step; or take "
            "'semi_implicit_euler' or 'rk4'"
        )
    return limit


def stable_dt_in_layer(scene: Scene, integrator: str, k: int, depth: float) -> float:
    """Return the stable time step with mass points so deep [m] in the layer of an obstacle [s].

    Bounds at depth d: stiffness 6 k (d/h)^2, damping c F0 + 2 mu F0 / v_s, F0 = k d^3 / h^2, over
    the mass of the lightest free point, beside those of the springs.
    """
    thickness, bounds = _thickness_and_bounds(scene, k)
    return _stable_dt_at_part(integrator, bounds, depth / thickness)


def stable_layer_depths(scene: Scene, integrator: str, dt: float) -> list[float]:
    """Return, for each obstacle, the depth in its layer up to which a time step is stable [m].

    It is infinite for responses after the step, and where the step is too long without contact.
    """
    depths = [math.inf] * len(scene.spheres)
    if dt <= stable_dt(scene, integrator):
        for k, obstacle in enumerate(scene.spheres):
            if obstacle.response == "penalty":
                thickness, bounds = _thickness_and_bounds(scene, k)
                depths[k] = thickness * _stable_part_of_thickness(integrator, bounds, dt)
    return depths


class _LayerBounds(NamedTuple):
    """Bounds of the modes of a cloth, and what a point in a layer adds to them."""

    stiffness: float  # of the springs [1/s^2]
    damping: float  # of the springs and drag [1/s]
    square: float  # of the stiffness, times (d/h)^2 [1/s^2]
    cube: float  # of the damping, times (d/h)^3 [1/s]


def _thickness_and_bounds(scene: Scene, k: int) -> tuple[float, _LayerBounds]:
    """Return the thickness of the layer of an obstacle [m], and the bounds in it."""
    obstacle = scene.spheres[k]
    cloth = scene.cloth
    layer = obstacle.layer(cloth)
    mass = float(cloth.mass_per_point.min(initial=math.inf, where=~cloth.pinned))
    thickness = layer["thickness"]
    stiffness = layer["stiffness"]
    damping = layer["dissipation"] + 2 * obstacle.friction / layer["slip_speed"]
    omega2, delta = _core.mode_bounds(cloth.core, scene.core_forces)
    bounds = _LayerBounds(
        stiffness=omega2,
        damping=delta,
        square=6 * stiffness / mass,
        cube=damping * stiffness * thickness / mass,
    )
    return thickness, bounds


def _stable_dt_at_part(integrator: str, bounds: _LayerBounds, part: float) -> float:
    """Return the stable time step at `part` of the thickness of a layer [s]."""
    stiffness = bounds.stiffness + bounds.square * part**2
    return stable_dt_of_box(
        integrator, math.sqrt(stiffness), bounds.damping + bounds.cube * part**3
    )


_BISECTIONS = 12  # of a depth, to 5e-4 of the thickness


@lru_cache(maxsize=4096)
def _stable_part_of_thickness(integrator: str, bounds: _LayerBounds, dt: float) -> float:
    """Return the part of the thickness of a layer up to which a time step is stable."""
    low = 0.0
    high = 2.0
    if _stable_dt_at_part(integrator, bounds, high) >= dt:
        return math.inf
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if _stable_dt_at_part(integrator, bounds, middle) >= dt:
            low = middle
        else:
            high = middle
    return low


_TIE = 0.95  # families whose removal lowers the bound by this part of the most are named together


@dataclass(frozen=True)
class LimitingTerm:
    """The term that limits the stable time step."""

    # The kind is "stiffness", "damping", "nothing", or "method" where the integrator has no stable
    # time step for this cloth.
    kind: str
    # The spring families of the term, and "points" for drag; or the name of another force alone.
    families: tuple[str, ...]
    values: tuple[float, ...]  # for each family [N/m] or [N s/m]; of another force [1/s]
    # Below these values the other kind limits the step, all families reduced in proportion; 0 if
    # there is none.
    below: tuple[float, ...]
    max_stable_dt: float  # the stable time step [s]
    integrator: str

    def __str__(self) -> str:
        if self.kind == "nothing":
            return "nothing limits it"
        if self.kind == "method":
            return f"{self.integrator} amplifies undamped motion at every time step"
        if not {*FAMILIES, "points"}.issuperset(self.families):
            (force,) = self.families
            return f"the damping of the {force}, {self.values[0]:.3g} 1/s at most, limits it"
        *most, last = [f for f in self.families if f != "points"] or [""]
        names = [f"the {self.kind} of {', '.join(most)}{' and ' * bool(most)}{last} springs"]
        names = names if last else []
        names += ["the drag of points"] * ("points" in self.families)
        name = " and ".join(names)
        other = "stiffness" if self.kind == "damping" else "damping"
        text = f"{name}, {self._format_numbers(self.values)}, limits it"
        return (
            f"{text}; below {self._format_numbers(self.below)} the {other} would"
            if any(self.below)
            else text
        )

    def _format_numbers(self, numbers: tuple[float, ...]) -> str:
        different = dict.fromkeys(f"{number:.3g}" for number in numbers)
        return f"{' and '.join(different)} {'N/m' if self.kind == 'stiffness' else 'N s/m'}"


def limiting_term(scene: Scene, integrator: str) -> LimitingTerm:
    """Return the term that limits the step that `stable_dt` gives for a scene."""
    if METHODS[integrator].family == "stabilised":
        integrator = "rk4"
    cloth = scene.cloth
    forces = tuple(
        (force.name, force.damping_bound(cloth.core))
        for force in scene.core_forces
        if force.name != "drag"
    )
    return _limiting_term_of(cloth, forces, integrator)


@lru_cache(maxsize=64)
def _limiting_term_of(
    cloth: Cloth, forces: tuple[tuple[str, float], ...], integrator: str
) -> LimitingTerm:
    """Return the term of a cloth and of forces with their bounds of damping rates [1/s]."""
    rates = dict(forces)

    def bounds(**changes: Any) -> tuple[float, float]:
        scene = Scene(cloth.replace(**changes, pins=cloth.pinned))
        omega2, delta = _core.mode_bounds(scene.cloth.core, scene.core_forces)
        return math.sqrt(omega2), delta + sum(rates.values())

    k = cloth.family_stiffness
    c = cloth.family_damping
    omega, delta = bounds()
    limit = stable_dt_of_box(integrator, omega, delta)
    limit_undamped = stable_dt_of_box(integrator, omega, 0.0)
    limit_damping = stable_dt_of_box(integrator, 0.0, delta)
    if limit == 0 or not math.isfinite(limit):
        return LimitingTerm(
            kind="method" if limit == 0 else "nothing",
            families=(),
            values=(),
            below=(),
            max_stable_dt=limit,
            integrator=integrator,
        )
    if limit_damping < limit_undamped:
        kind = "damping"
        factor = limit_damping / limit_undamped
        bound = delta
        bounds_without = {f: bounds(damping={**c, f: 0.0})[1] for f in c}
        bounds_without["points"] = bounds(drag=0.0)[1]
        bounds_without |= {name: delta - rate for name, rate in rates.items()}
        values = {**c, "points": cloth.drag, **rates}
    else:
        kind = "stiffness"
        factor = (limit_undamped / limit_damping) ** 2
        bound = omega
        bounds_without = {f: bounds(stiffness={**k, f: 0.0})[0] for f in k}
        values = k
    fall = {f: bound - rest for f, rest in bounds_without.items()}
    families = tuple(f for f in fall if fall[f] >= _TIE * max(fall.values()))
    if families[-1] in rates:  # its value has another unit
        families = families[-1:]
    terms = tuple(values[f] for f in families)
    below = tuple(factor * term for term in terms)
    return LimitingTerm(
        kind=kind,
        families=families,
        values=terms,
        below=below,
        max_stable_dt=limit,
        integrator=integrator,
    )
