"""A run in six lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..model.scene import Scene
from ..model.wording import cloth_text, counted, joules, quantity, spheres_text


def run_lines(scene: Scene, t: Any, report: Mapping[str, Any], adaptive: bool) -> list[str]:
    """Six lines: the scene, frames at the times `t`, steps, energy, penetration, and speed."""
    steps, dt = report.get("steps"), report.get("dt")
    how = " in ".join(str(report[k]) for k in ("integrator", "precision") if k in report)
    step = "" if dt is None else f" of {'about ' if adaptive else ''}{quantity(dt, 's')}"
    stopped = report.get("stopped")
    end = f", stopped early ({stopped})" if stopped else ""
    frames = "1 frame" if len(t) == 1 else f"{len(t):,} frames"
    return [
        f"Run of {cloth_text(scene)}, {spheres_text([scene])}",
        f"{frames} from t = {t[0]:.6g} to {t[-1]:.6g} s{end}",
        f"{'steps' if steps is None else counted(steps, 'step')}{step}{f' by {how}' if how else ''}",
        _energy_line(report.get("energy", {})),
        _penetration_line(scene, report.get("penetration", {})),
        _speed_line(report),
    ]


def _energy_line(energy: Mapping[str, Any]) -> str:
    try:
        start, end = energy["start"]["total"], energy["end"]["total"]
    except (KeyError, TypeError):
        return "energy not known"
    start, end, change = joules([start, end, end - start])
    return f"energy {start} at the start, {end} at the end (change, by damping and contact, {change})"


def _penetration_line(scene: Scene, depths: Mapping[str, Any]) -> str:
    if not scene.spheres:
        return "penetration: no sphere"
    known = {name: depths.get(name, math.nan) for name in ("points", "triangles")}
    if all(map(math.isnan, known.values())):
        return f"deepest penetration not known: {depths.get('reason') or 'not measured'}"
    parts = [f"{name} {quantity(depth, 'm')}" for name, depth in known.items() if depth == depth]
    return f"deepest penetration: {', '.join(parts)}"


def _speed_line(report: Mapping[str, Any]) -> str:
    seconds, speed = report.get("wall_time"), report.get("steps_per_second")
    if seconds is None or speed is None:
        return "speed not known"
    threads = report.get("threads")
    on = f" on {counted(threads, 'thread')}" if threads else ""
    return f"{seconds:.3g} s of computing{on}, {speed:,.0f} steps/s"
