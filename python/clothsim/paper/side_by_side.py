"""The responses side by side on the static, the moving and a fast sphere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import clothsim as cs

from .experiments import Passed

RESPONSES: dict[str, dict[str, Any]] = {
    "reflect, as printed": {"response": "reflect", "as_printed": True},
    "ray, as printed": {"response": "ray", "as_printed": True},
    "reflect, corrected": {"response": "reflect"},
    "ray, corrected": {"response": "ray"},
    "continuous": {"response": "continuous"},
    "continuous, cell": {"response": "continuous", "offset": "cell"},
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


def follow(
    name: str, response: str, end: float | None = None, every: int = INSPECTION, dt: float | None = None
) -> dict[str, Any]:
    """One row of the table: run a scene with a response and watch every step.

    "points" and "triangles" are the deepest [m], "crossings" mass points that passed through the sphere. "energy_gained" [J]
    is the change of the total energy: damping takes, contacts and a moving sphere add. "failure" is None, or why the run
    ended early.
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
    x, t, passed = stepper.positions, stepper.time, Passed(scene)
    for k in range(round((end or duration) / dt)):
        try:
            stepper.advance(1, dt)
        except cs.UnstableError as error:
            row["failure"] = f"unstable at t = {error.time:g} s"
            break
        x, t = stepper.positions, stepper.time
        passed.see(x, t)
        depth = sphere.radius - np.linalg.norm(x - sphere.center_at(t), axis=-1).min()
        row["points"] = max(row["points"], float(depth))
        if k % every == 0:
            depths = cs.penetration(x, sphere, t)
            row["triangles"] = max(row["triangles"], float(depths["triangles"]))
    row["triangles"], row["crossings"] = max(row["triangles"], row["points"]), passed.count
    ends = (scene.initial_position, scene.initial_velocity), (x, stepper.velocities)
    start, now = (float(cs.energy(scene, *state)["total"]) for state in ends)
    row["energy_gained"] = now - start
    row["time"] = t
    return row


def comparison(
    scenes: Sequence[str] = tuple(SCENES),
    responses: Sequence[str] = tuple(RESPONSES),
    *,
    part: float = 1.0,
    advance: Callable[[int], object] = lambda rows: None,
) -> list[dict[str, Any]]:
    """The table: every response on every scene, as from `follow`.

    `part` of the scenes' durations is run; the fast one is run whole. `advance` is called with 1 after each row.
    """
    rows = []
    for name in scenes:
        for response in responses:
            end = SCENES[name][2] * (part if name != "fast" else 1.0)
            rows.append(follow(name, response, end))
            advance(1)
    return rows
