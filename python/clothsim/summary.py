"""Short texts of runs, scenes and steppers, for `print` and for a notebook."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .run import Run
    from .scene import Scene
    from .stepper import Stepper


def run_lines(run: Run) -> list[str]:
    """At most six lines: the scene, frames, steps, energy, penetration, and speed."""
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
        f"{_count(steps, 'step')}{step}{f' by {how}' if how else ''}",
        _energy_line(report.get("energy", {})),
        _penetration_line(run.scene, report.get("penetration", {})),
        _speed_line(report),
    ]


def scene_lines(scene: Scene) -> list[str]:
    """Four lines: cloth, springs, spheres and gravity."""
    cloth = scene.cloth
    rows, columns = cloth.size
    mass = float(cloth.mass_per_point.sum())
    springs = ", ".join(f"{k:g} N/m {name}" for name, k in cloth.family_stiffness.items())
    pinned = int(cloth.pinned.sum())
    return [
        f"Scene of {_cloth(scene)}, {rows:g} x {columns:g} m, {_number(mass, 'kg')}",
        f"{cloth.spring_count():,} springs ({springs or 'none'}), {_count(pinned, 'pinned point')}",
        _spheres([scene]),
        f"gravity ({', '.join(f'{g:g}' for g in scene.gravity)}) m/s^2",
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
    ends = f"{_number(start, 'J')} at the start, {_number(end, 'J')} at the end"
    return f"energy {ends} ({end - start:+.4g} J)"


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


def _count(number: int | None, noun: str) -> str:
    return f"{number or 0:,} {noun}{'' if number == 1 else 's'}"


def _number(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"
