"""The responses side by side on the static, the moving and a fast sphere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import clothsim as cs

from ..base.clocks import Stopwatch, turns

RESPONSES: dict[str, dict[str, Any]] = {
    "reflect, as printed": {"response": "reflect", "as_printed": True},
    "ray, as printed": {"response": "ray", "as_printed": True},
    "reflect, corrected": {"response": "reflect"},
    "ray, corrected": {"response": "ray"},
    "continuous": {"response": "continuous"},
    "continuous, cell": {"response": "continuous", "offset": "cell"},
    "continuous, face": {"response": "continuous", "offset": "face"},
}


def _fast() -> cs.Scene:
    """The paper's cloth, level, and its sphere on the way up through it at 100 m/s."""
    scene = cs.scenes.paper_static()
    sphere = scene.spheres[0].replace(center=(0.5, -0.3, 0.5), motion=cs.Linear((0, 100.0, 0)))
    return scene.replace(spheres=(sphere,))


# Name: scene, time step [s], times at which it begins and ends [s].
SCENES: dict[str, tuple[Callable[[], cs.Scene], float, float]] = {
    "static": (cs.scenes.paper_static, 1e-4, 0.8),
    "moving": (cs.scenes.paper_moving, 1e-4, 0.9),
    "fast": (_fast, 1e-4, 0.012),
}
INSPECTION = 4  # steps between two inspections of the triangles


def scene_of(name: str, response: str) -> cs.Scene:
    """The scene `name` of `SCENES` with one of `RESPONSES`."""
    scene = SCENES[name][0]()
    return scene.replace(spheres=tuple(s.replace(**RESPONSES[response]) for s in scene.spheres))


def passes(x0: np.ndarray, x1: np.ndarray, sphere: cs.Sphere, t0: float, t1: float) -> int:
    """Mass points outside at both times whose straight way, in the sphere's frame, went through."""
    p0, p1 = x0 - sphere.center_at(t0), x1 - sphere.center_at(t1)
    q = p1 - p0
    a = (q * q).sum(axis=-1)
    s = np.clip(-(p0 * q).sum(axis=-1) / np.where(a > 0, a, 1), 0, 1)
    nearest = np.linalg.norm(p0 + s[..., None] * q, axis=-1)
    r = sphere.radius
    outside = (np.linalg.norm(p0, axis=-1) >= r) & (np.linalg.norm(p1, axis=-1) >= r)
    return int((outside & (nearest < r * (1 - 1e-9))).sum())


def follow(
    name: str, response: str, end: float | None = None, every: int = INSPECTION, dt: float | None = None
) -> dict[str, Any]:
    """One row of the table: run a scene with a response and watch every step.

    "points" and "triangles" are the deepest [m], "crossings" mass points that passed through between two steps.
    "energy_gained" [J] is the change of the total energy: damping takes, contacts and a moving sphere add. "failure" is
    None, or why the run ended early.
    """
    _, usual, duration = SCENES[name]
    dt = dt or usual
    scene = scene_of(name, response)
    sphere = scene.spheres[0]
    stepper = cs.Stepper(scene, threads=1)
    row: dict[str, Any] = {
        "scene": name,
        "response": response,
        "points": 0.0,
        "triangles": 0.0,
        "crossings": 0,
        "failure": None,
    }
    x, t = stepper.positions, stepper.time
    for k in range(round((end or duration) / dt)):
        try:
            stepper.advance(1, dt)
        except cs.UnstableError as error:
            row["failure"] = f"unstable at t = {error.time:g} s"
            break
        before, t0, x, t = x, t, stepper.positions, stepper.time
        row["crossings"] += passes(before, x, sphere, t0, t)
        depth = sphere.radius - np.linalg.norm(x - sphere.center_at(t), axis=-1).min()
        row["points"] = max(row["points"], float(depth))
        if k % every == 0:
            depths = cs.penetration(x, sphere, t)
            row["triangles"] = max(row["triangles"], float(depths["triangles"]))
    row["triangles"] = max(row["triangles"], row["points"])
    ends = (scene.initial_position, scene.initial_velocity), (x, stepper.velocities)
    start, now = (float(cs.energy(scene, *state)["total"]) for state in ends)
    row["energy_gained"] = now - start
    row["time"] = t
    return row


def _cost(rows: Sequence[dict[str, Any]], windows: int = 30, steps: int = 20) -> None:
    """Adds "microseconds_per_step" in the middle of each scene's contact, least of windows."""
    timed = []
    for row in rows:
        _, dt, duration = SCENES[row["scene"]]
        stepper = cs.Stepper(scene_of(row["scene"], row["response"]), threads=1)
        row["microseconds_per_step"] = None
        try:
            stepper.advance(round(0.4 * duration / dt), dt)
            snapshot = stepper.snapshot()
            stepper.advance(1 + steps, dt)
        except cs.UnstableError:
            continue
        timed.append((row, snapshot, dt))
    for k in turns(len(timed), windows):
        row, snapshot, dt = timed[k]
        stepper = cs.Stepper.restore(snapshot)
        stepper.advance(1, dt)  # makes the engine
        with Stopwatch() as watch:
            stepper.advance(steps, dt)
        taken = 1e6 * watch.seconds / steps
        row["microseconds_per_step"] = min(taken, row["microseconds_per_step"] or taken)


def comparison(
    scenes: Sequence[str] = tuple(SCENES),
    responses: Sequence[str] = tuple(RESPONSES),
    *,
    part: float = 1.0,
    timed: bool = True,
    advance: Callable[[int], object] = lambda rows: None,
) -> list[dict[str, Any]]:
    """The table: every response on every scene, as from `follow`.

    `part` of the scenes' durations is run; the fast one is run whole. `timed` also measures "microseconds_per_step", the
    cost of a step in contact, on one thread in double. `advance` is called with 1 after each row.
    """
    rows = []
    for name in scenes:
        for response in responses:
            end = SCENES[name][2] * (part if name != "fast" else 1.0)
            rows.append(follow(name, response, end))
            advance(1)
    if timed:
        _cost(rows)
    return rows
