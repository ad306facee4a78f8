"""What a thinner, stiffer or more dissipative layer costs and gives, on the paper's sheet."""

from __future__ import annotations

import math
import warnings
from typing import Any

import clothsim as cs

from .compare import distance

# Thickness over the spacing, stiffness over that of the springs, dissipation [s/m], and, with
# friction 0.3, the slip speed [m/s].
LAYERS: tuple[tuple[float, float, float, float | None], ...] = (
    (0.25, 10.0, 1.2, None),
    (0.25, 10.0, 2.0, None),
    (0.25, 8.0, 2.0, None),
    (0.25, 10.0, 5.0, None),
    (0.25, 12.0, 2.0, None),
    (0.15, 8.0, 2.0, None),
    (0.15, 22.0, 1.2, None),
    (0.08, 28.0, 2.0, None),
    (0.03, 200.0, 2.0, None),
    (0.25, 10.0, 2.0, 1e-2),
    (0.25, 10.0, 2.0, 1e-3),
)
_FRICTION = 0.3
_REST = 3.0, 10.0  # drag [N s/m] of the sheet whose rest is sought, and its duration [s]


def layer(
    layers: int = len(LAYERS), rtol: float = 1e-5, dt: float = 2.5e-4
) -> list[dict[str, Any]]:
    """Return evaluations, error at 1 s and distances from the sphere, for the first of `LAYERS`.

    Errors are rms distances from a run at a tolerance 100 times tighter.

    Returns
    -------
    list of dict
        "thickness", "stiffness", "dissipation" and "slip_speed" of a layer, and the "speed" that it
        takes;
        "evaluations" and "error" of the run at `rtol`; "rk4_error" at the step `dt`; "stand_off",
        the mean gap between the true surface and the points in the layer, at rest; "least_gap" to
        the true surface and the deepest "triangle" on the way.
    """
    rows = []
    with warnings.catch_warnings():
        # Points below the surface and steps that are long for a layer are figures of the table.
        warnings.simplefilter("ignore", cs.ContactWarning)
        warnings.simplefilter("ignore", cs.StabilityWarning)
        for values in LAYERS[:layers]:
            rows.append(_row(*values, rtol, dt))
    return rows


def _row(
    thickness: float,
    stiffness: float,
    dissipation: float,
    slip_speed: float | None,
    rtol: float,
    dt: float,
) -> dict[str, Any]:
    cloth = cs.Cloth()
    length = thickness * min(cloth.spacing)
    spring = max(cloth.family_stiffness.values())
    ball = cs.Sphere(
        (0.5, -0.5, 0.5),
        0.25,
        thickness=length,
        stiffness=stiffness * spring,
        dissipation=dissipation,
        friction=_FRICTION if slip_speed else 0.0,
        slip_speed=slip_speed,
    )
    scene = cs.Scene(cloth, ball)
    run = cs.simulate(scene, 1.0, rtol=rtol)
    # Frames cost evaluations, so that the run whose evaluations count has none.
    solution = cs.simulate(scene, 1.0, rtol=rtol / 100, fps=1000)
    try:
        rk4_error = distance(cs.simulate(scene, 1.0, dt=dt), solution)
    except (cs.ContactError, cs.UnstableError):
        rk4_error = math.inf
    drag, duration = _REST
    rest = cs.simulate(scene.replace(cloth=cloth.replace(drag=drag)), duration, dt=5e-5)
    heights = ball.height(rest.x[-1])
    contacts = heights < ball.offset_length(cloth) + length
    return {
        "thickness": thickness,
        "stiffness": stiffness,
        "dissipation": dissipation,
        "slip_speed": slip_speed,
        "speed": length * math.sqrt(stiffness * spring / (2 * cloth.mass_per_point.mean())),
        "evaluations": run.report["solution_evaluations"],
        "error": distance(run, solution),
        "rk4_error": rk4_error,
        "stand_off": float(heights[contacts].mean()),
        "least_gap": float(ball.height(solution.x).min()),
        "triangle": solution.report["penetration"]["triangles"],
    }
