"""A scene, or the state of a stepper, in six lines for `print` and for a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base import Floats
from ..engine.stepper import Stepper
from ..methods.bound import stable_dt
from ..methods.limiting import limiting_term
from ..model.scene import Scene
from ..model.wording import cloth_text, counted, joules, quantity, spheres_text
from .measures import energy, penetration

_ENERGIES = ("kinetic", "elastic", "gravity", "force")


def scene_lines(scene: Scene) -> list[str]:
    """Six lines: cloth, springs, spheres, gravity, initial state and stable time step."""
    cloth = scene.cloth
    rows, columns = cloth.size
    mass = float(cloth.mass_per_point.sum())
    pinned = counted(int(cloth.pinned.sum()), "pinned point")
    springs = ", ".join(f"{k:g} N/m {name}" for name, k in cloth.family_stiffness.items())
    state = _State([scene], scene.initial_position[None], scene.initial_velocity[None], 0.0)
    return [
        f"Scene of {cloth_text(scene)}, {rows:g} x {columns:g} m, {quantity(mass, 'kg')}",
        f"{counted(cloth.spring_count(), 'spring')} ({springs or 'none'}), {pinned}",
        f"{spheres_text([scene])}, gravity ({', '.join(f'{g:g}' for g in scene.gravity)}) m/s^2",
        f"initial {state.energy()}",
        f"initial {state.penetration()}",
        _stable_step([scene], "rk4"),
    ]


def stepper_state_lines(stepper: Stepper) -> list[str]:
    """Six lines: those of `stepper_lines`, energy and penetration now, and the stable time step."""
    scenes = stepper._state.scenes
    x, v = (np.asarray(one, np.float64).reshape(-1, *scenes[0].cloth.shape, 3) for one in (stepper.x, stepper.v))
    state = _State(scenes, x, v, stepper.time)
    return [*stepper._lines(), state.energy(), state.penetration(), _stable_step(scenes, stepper._state.integrator)]


@dataclass(frozen=True)
class _State:
    """States of scenes, shape (B, rows, columns, 3), at a time [s]."""

    scenes: Sequence[Scene]
    x: Floats
    v: Floats
    t: float

    def energy(self) -> str:
        """Total energy with its parts, or its range over a batch."""
        found = [energy(scene, x, v) for scene, x, v in zip(self.scenes, self.x, self.v)]
        if len(found) > 1:
            return f"energy {_range([float(one['total']) for one in found], 'J')}"
        kinds = _ENERGIES if self.scenes[0].force is not None else _ENERGIES[:3]
        values = [float(found[0][name]) for name in ("total", *kinds)]
        total, *parts = joules(values, _rounding(self.scenes[0]))
        return f"energy {total} ({', '.join(map(' '.join, zip(kinds, parts)))})"

    def penetration(self) -> str:
        """Deepest penetration over the spheres, and over a batch."""
        spheres = [(x, sphere) for scene, x in zip(self.scenes, self.x) for sphere in scene.spheres]
        if not spheres:
            return "penetration: no sphere"
        found = [penetration(x, sphere, self.t) for x, sphere in spheres]
        parts = [f"{name} {quantity(max(float(one[name]) for one in found), 'm')}" for name in ("points", "triangles")]
        return f"deepest penetration: {', '.join(parts)}"


def _stable_step(scenes: Sequence[Scene], integrator: str) -> str:
    """The guaranteed stable step. For one scene, the line also names the term that limits it."""
    if len(scenes) > 1:
        limits = [float(stable_dt(scene, integrator)) for scene in scenes]
        return f"stable time step {_range(limits, 's')} with {integrator}"
    term = limiting_term(scenes[0], integrator)
    return f"stable time step {quantity(term.max_stable_dt, 's')} with {integrator}, limited by {term.name}"


def _range(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    return quantity(low, unit) if low == high else f"{low:.4g} to {quantity(high, unit)}"


def _rounding(scene: Scene) -> float:
    """Energy [J] of one spring of the cloth's length that a strain of 1e-10 stretches."""
    largest = max(scene.cloth.family_stiffness.values(), default=0.0)
    return 1e-20 * largest * max(scene.cloth.size) ** 2
