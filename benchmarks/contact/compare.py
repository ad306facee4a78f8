"""Error of the responses against their cost in force evaluations."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.typing import Response

_BALL = cs.Sphere((0.5, -0.5, 0.5), 0.25)
_BALLS = [cs.Sphere((x, -0.16, z), 0.15) for x, z in ((0.3, 0.3), (0.7, 0.4), (0.45, 0.7))]
# The scene, and its duration [s]: sheets without pins fold later.
SCENES: dict[str, tuple[cs.Scene, float]] = {
    "the paper's sheet on its sphere, 1 s": (cs.Scene(cs.Cloth(), _BALL), 1.0),
    "a free drape, 0.35 s": (
        cs.Scene(cs.Cloth(pins=()), _BALL.replace(center=(0.5, -0.3, 0.5))),
        0.35,
    ),
    "on three spheres, 0.5 s": (cs.Scene(cs.Cloth(pins=()), _BALLS), 0.5),
    "a ball on a floor, 1 s": (cs.Scene(cs.Cloth(), (_BALL, cs.Plane((0.0, -0.75, 0.0)))), 1.0),
}
RESPONSES: tuple[Response, ...] = ("penalty", "ray", "reflect")
_DTS = [5e-4 / 2**k for k in range(5)]  # s, of rk4
_RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_FINEST_RTOL = 1e-8
_COLORS = {"penalty": "#0072B2", "ray": "#009E73", "reflect": "#CC79A7"}
_MARKERS = {"penalty": "o", "ray": "^", "reflect": "v"}


def distance(run: cs.Run, solution: cs.Run) -> float:
    """Root mean square over the mass points of the distance at the end [m]."""
    offset = run.x[-1] - solution.x[-1]
    return float(np.sqrt((offset**2).sum(-1).mean()))


def compare(scenes: int = len(SCENES), steps: int = len(_DTS)) -> list[dict[str, Any]]:
    """Errors of every response, by rk4 and, for "penalty", by error control.

    The laws differ, so each response is compared with its own finest run: "penalty" with one at a
    tolerance of 1e-8, the others with rk4 at a quarter of the last step.

    Returns
    -------
    list of dict
        "scene", "response", "method", "setting" (step [s] or tolerance), force "evaluations" of the
        run, "error" [m].
    """
    rows = []
    for name, (scene, duration) in list(SCENES.items())[:scenes]:
        for response in RESPONSES:
            obstacles = [obstacle.replace(response=response) for obstacle in scene.spheres]
            variant = scene.replace(spheres=obstacles)
            settings: list[dict[str, float]] = [{"dt": dt} for dt in _DTS[:steps]]
            finest = {"dt": settings[-1]["dt"] / 4}
            if response == "penalty":
                settings += [{"rtol": rtol} for rtol in _RTOLS]
                finest = {"rtol": _FINEST_RTOL}
            with warnings.catch_warnings():
                # Coarse steps go deep; that shows in their errors.
                warnings.simplefilter("ignore", cs.ContactWarning)
                warnings.simplefilter("ignore", cs.StabilityWarning)
                solution = cs.simulate(variant, duration, **finest)
                for setting in settings:
                    run = cs.simulate(variant, duration, **setting)
                    rows.append(
                        {
                            "scene": name,
                            "response": response,
                            "method": run.report["integrator"],
                            "setting": next(iter(setting.values())),
                            "evaluations": run.report["solution_evaluations"],
                            "error": distance(run, solution),
                        }
                    )
    return rows


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Write a picture of the rows of `compare`, one panel a scene."""
    from matplotlib import pyplot

    pyplot.rcParams.update({"font.size": 11})
    names = list(dict.fromkeys(row["scene"] for row in rows))
    figure, panels = pyplot.subplots(
        1,
        len(names),
        figsize=(3.5 * len(names), 3.7),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for panel, name in zip(panels[0], names, strict=True):
        lines: dict[tuple[str, str], list[tuple[float, float]]] = {}
        for row in rows:
            if row["scene"] == name:
                line = lines.setdefault((row["response"], row["method"]), [])
                line.append((row["evaluations"], row["error"]))
        for (response, method), points in lines.items():
            panel.loglog(
                *zip(*points, strict=True),
                color=_COLORS[response],
                marker=_MARKERS[response],
                ls="-" if method == "rk4" else "--",
                label=f'"{response}", {method}' + (" with rtol" if method != "rk4" else ""),
            )
        panel.set(title=name, xlabel="force evaluations", xlim=(1e3, 2e5))
        panel.title.set_fontsize(11)
        panel.grid(alpha=0.3)
    panels[0][0].set_ylabel("rms error at the end [m]")
    figure.legend(
        *panels[0][0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=5,
        frameon=False,
    )
    figure.savefig(path, dpi=100)
    pyplot.close(figure)
