"""Short texts of runs, scenes and steppers, for `print` and for a notebook."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..engine.limiting import limiting_term
from ..measure.measures import energy, max_stable_dt, penetration

if TYPE_CHECKING:
    from ..engine.stepper import Stepper
    from ..run.result import Run
    from .scene import Scene

Floats = npt.NDArray[np.float64]

_ENERGIES = ("kinetic", "elastic", "gravity")


def run_lines(run: Run) -> list[str]:
    """Six lines: the scene, frames, steps, energy, penetration, and speed."""
    report = run.report
    steps, dt = report.get("steps"), report.get("dt")
    how = " in ".join(str(report[k]) for k in ("integrator", "precision") if k in report)
    adaptive = run.continuation is not None and run.continuation.dt is None
    step = "" if dt is None else f" of {'about ' if adaptive else ''}{_number(dt, 's')}"
    stopped = report.get("stopped")
    end = f", stopped early ({stopped})" if stopped else ""
    frames = "1 frame" if len(run.t) == 1 else f"{len(run.t):,} frames"
    return [
        f"Run of {_cloth(run.scene)}, {_spheres([run.scene])}",
        f"{frames} from t = {run.t[0]:.6g} to {run.t[-1]:.6g} s{end}",
        f"{'steps' if steps is None else _count(steps, 'step')}{step}{f' by {how}' if how else ''}",
        _energy_line(report.get("energy", {})),
        _penetration_line(run.scene, report.get("penetration", {})),
        _speed_line(report),
    ]


def scene_lines(scene: Scene) -> list[str]:
    """Six lines: cloth, springs, spheres, gravity, initial state and stable time step."""
    cloth = scene.cloth
    rows, columns = cloth.size
    mass = float(cloth.mass_per_point.sum())
    springs = ", ".join(f"{k:g} N/m {name}" for name, k in cloth.family_stiffness.items())
    state = _State([scene], scene.initial_position[None], scene.initial_velocity[None], 0.0)
    return [
        f"Scene of {_cloth(scene)}, {rows:g} x {columns:g} m, {_number(mass, 'kg')}",
        f"{_count(cloth.spring_count(), 'spring')} ({springs or 'none'}), {_count(int(cloth.pinned.sum()), 'pinned point')}",
        f"{_spheres([scene])}, gravity ({', '.join(f'{g:g}' for g in scene.gravity)}) m/s^2",
        f"initial {state.energy()}",
        f"initial {state.penetration()}",
        _stable_step([scene], "rk4"),
    ]


def stepper_lines(stepper: Stepper) -> list[str]:
    """Three lines: the scene, the time, and how steps are computed."""
    state, options = stepper._state, stepper._options
    scenes, shape = state.scenes, state.shape
    batch = f"a batch of {shape[0]}, each " if len(shape) == 4 else ""
    how = f"{state.integrator} in {options['precision']}, kernel {stepper.kernel}"
    return [
        f"Stepper of {batch}{_cloth(scenes[0])}, {_spheres(scenes)}",
        f"t = {stepper.time:.6g} s",
        f"{how}, {_count(stepper.threads, 'thread')}, {stepper.instruction_set}",
    ]


def stepper_state_lines(stepper: Stepper) -> list[str]:
    """Six lines: those of `stepper_lines`, energy and penetration now, and the stable time step."""
    scenes = stepper._state.scenes
    x, v = (np.asarray(one, np.float64).reshape(-1, *scenes[0].cloth.shape, 3) for one in stepper._arrays())
    state = _State(scenes, x, v, stepper.time)
    return [*stepper_lines(stepper), state.energy(), state.penetration(), _stable_step(scenes, stepper._state.integrator)]


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
        values = [float(found[0][name]) for name in ("total", *_ENERGIES)]
        total, *parts = _joules(values, _rounding(self.scenes[0]))
        return f"energy {total} ({', '.join(map(' '.join, zip(_ENERGIES, parts)))})"

    def penetration(self) -> str:
        """Deepest penetration over the spheres, and over a batch."""
        spheres = [(x, sphere) for scene, x in zip(self.scenes, self.x) for sphere in scene.spheres]
        if not spheres:
            return "penetration: no sphere"
        found = [penetration(x, sphere, self.t) for x, sphere in spheres]
        parts = [f"{name} {_number(max(float(one[name]) for one in found), 'm')}" for name in ("points", "triangles")]
        return f"deepest penetration: {', '.join(parts)}"


def _stable_step(scenes: Sequence[Scene], integrator: str) -> str:
    """The guaranteed stable step, of one scene with the term that limits it."""
    if len(scenes) > 1:
        limits = [float(max_stable_dt(scene, integrator)) for scene in scenes]
        return f"stable time step {_range(limits, 's')} with {integrator}"
    term = limiting_term(scenes[0], integrator)
    return f"stable time step {_number(term.max_stable_dt, 's')} with {integrator}, limited by {term.name}"


def _range(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    return _number(low, unit) if low == high else f"{low:.4g} to {_number(high, unit)}"


def _cloth(scene: Scene) -> str:
    rows, columns = scene.cloth.shape
    return f"{rows} x {columns} mass points"


def _spheres(scenes: Sequence[Scene]) -> str:
    """Number of spheres and their responses, of scenes that have as many; else of all."""
    found = {len(scene.spheres) for scene in scenes}
    if len(found) > 1:
        return f"{min(found)} to {max(found)} spheres"
    spheres = scenes[0].spheres
    if not spheres:
        return "no sphere"
    kinds = Counter(f"{'moving, ' if s.motion else ''}response {s.response}" for s in spheres)
    parts = [kind if n == len(spheres) else f"{n} {kind}" for kind, n in kinds.items()]
    return f"{_count(len(spheres), 'sphere')} ({'; '.join(parts)})"


def _energy_line(energy: Mapping[str, Any]) -> str:
    try:
        start, end = energy["start"]["total"], energy["end"]["total"]
    except (KeyError, TypeError):
        return "energy not known"
    start, end, drift = _joules([start, end, end - start])
    return f"energy {start} at the start, {end} at the end (drift {drift})"


def _rounding(scene: Scene) -> float:
    """Energy [J] of one spring of the cloth's length that a strain of 1e-10 stretches."""
    stiffest = max(scene.cloth.family_stiffness.values(), default=0.0)
    return 1e-20 * stiffest * max(scene.cloth.size) ** 2


def _joules(energies: Sequence[float], negligible: float = 0.0) -> list[str]:
    """Energies with their unit; rounding beside the largest, or below `negligible`, is 0."""
    negligible = max(negligible, 1e-15 * max(map(abs, energies)))
    return [_number(0.0 if abs(one) < negligible else one, "J") for one in energies]


def _penetration_line(scene: Scene, depths: Mapping[str, Any]) -> str:
    if not scene.spheres:
        return "penetration: no sphere"
    told = {name: depths.get(name, math.nan) for name in ("points", "triangles")}
    if all(map(math.isnan, told.values())):
        return f"deepest penetration not known: {depths.get('reason') or 'not measured'}"
    parts = [f"{name} {_number(depth, 'm')}" for name, depth in told.items() if depth == depth]
    return f"deepest penetration: {', '.join(parts)}"


def _speed_line(report: Mapping[str, Any]) -> str:
    seconds, speed = report.get("wall_time"), report.get("steps_per_second")
    if seconds is None or speed is None:
        return "speed not known"
    threads = report.get("threads")
    on = f" on {_count(threads, 'thread')}" if threads else ""
    return f"{seconds:.3g} s of computing{on}, {speed:,.0f} steps/s"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _number(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"
