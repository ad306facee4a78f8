"""Cost of a step with a sphere, against the step without."""

from __future__ import annotations

from typing import Any, get_args

import clothsim as cs
from clothsim.typing import Offset, Precision
from timing import Steps, measure

from .drape_cost import SCENES, drape_cost

# A variant's own step without a sphere, where it is not the one named first.
_WITHOUT = {"continuous, the paper's sphere in contact": "the paper's cloth, no sphere"}


def _steppers(precision: Precision) -> dict[str, cs.Stepper]:
    cloth = cs.Cloth(pins=())
    # Under the whole cloth, all 1,024 points on it.
    under = cs.Sphere(
        (0.5, -5.0, 0.5), 5.0, response="continuous", offset="none", restitution=0.0, friction=0.2
    )
    far = cs.Sphere((0.5, -9.0, 0.5), 0.25, response="continuous", offset="edge", restitution=1.0)
    settled = cs.Stepper(cs.Scene(cloth, under), threads=1)
    settled.advance(6000, 5e-5)
    on_cells = cs.Stepper(cs.Scene(cloth, under.replace(offset="cell")), threads=1)
    on_cells.advance(6000, 5e-5)
    paper = cs.scenes.paper_static("continuous")
    falling = cs.Stepper(paper, threads=1)
    falling.advance(4000, 1e-4)
    lying, folded = falling.positions, falling.velocities

    def stepper(spheres: Any, like: cs.Stepper) -> cs.Stepper:
        scene = cs.Scene(cloth, spheres)
        return cs.Stepper(scene, like.positions, like.velocities, threads=1, precision=precision)

    return {
        "no sphere": stepper((), settled),
        "ray, touching nothing": stepper(far.replace(response="ray"), settled),
        "continuous, touching nothing": stepper(far, settled),
        "continuous, all points in contact": stepper(under, settled),
        "continuous, all points sliding": stepper(under.replace(friction=0.0), settled),
        "continuous, all points, restitution 0.5": stepper(under.replace(restitution=0.5), settled),
        "the paper's cloth, no sphere": cs.Stepper(
            paper.replace(spheres=()), lying, folded, threads=1, precision=precision
        ),
        "continuous, the paper's sphere in contact": cs.Stepper(
            paper, lying, folded, threads=1, precision=precision
        ),
        "cell, touching nothing": stepper(far.replace(offset="cell"), settled),
        "cell, all points in contact": stepper(under.replace(offset="cell"), on_cells),
        "cell, all points sliding": stepper(under.replace(offset="cell", friction=0.0), on_cells),
    }


def cost(windows: int = 60, steps: int = 40, dt: float = 5e-6) -> list[dict[str, Any]]:
    """Least time of a step over many short windows, the variants in turn, one thread.

    The ratio is to the step without a sphere of the same cloth.
    """
    rows = []
    for precision in ("double", "single"):
        steppers = _steppers(precision)
        timings = measure([Steps(stepper, dt, steps) for stepper in steppers.values()], windows)
        least = dict(zip(steppers, (timing.minimum for timing in timings), strict=True))
        rows += [
            {
                "precision": precision,
                "variant": name,
                "microseconds": 1e6 * taken,
                "ratio": taken / least[_WITHOUT.get(name, "no sphere")],
            }
            for name, taken in least.items()
        ]
    return rows


def offsets(
    windows: int = 60, steps: int = 40, dt: float = 5e-6, scenes: int = len(SCENES)
) -> list[dict[str, Any]]:
    """Cost of every offset over a step without spheres, one thread: least times of many short
    windows.

    Nothing touches the sphere, or all points of the paper's cloth lie on it. The last figures are
    for the light drapes of `drape_cost`, in double: least and largest mean, and the worst window of
    50 steps.

    Returns
    -------
    list of dict
        "offset", "untouched", "touched" and "touched_in_single", "drape_least", "drape_mean",
        "drape_worst".
    """
    cloth, rows = cs.Cloth(pins=()), []
    for offset in get_args(Offset):
        under = cs.Sphere((0.5, -5.0, 0.5), 5.0, offset=offset, friction=0.2)
        settled = cs.Stepper(cs.Scene(cloth, under), threads=1)
        settled.advance(6000, 5e-5)
        ratios = {}
        for precision in ("double", "single"):
            works = [
                Steps(
                    cs.Stepper(
                        scene, settled.positions, settled.velocities, threads=1, precision=precision
                    ),
                    dt,
                    steps,
                )
                for scene in (
                    cs.Scene(cloth, s)
                    for s in ((), under.replace(center=(0.5, -9.0, 0.5), radius=0.25), under)
                )
            ]
            least = [timing.minimum for timing in measure(works, windows)]
            ratios[precision] = [time / least[0] for time in least]
        drapes = [drape_cost(name, offset) for name in list(SCENES)[:scenes]]
        rows.append(
            {
                "offset": offset,
                "untouched": max(ratios["double"][1], ratios["single"][1]),
                "touched": ratios["double"][2],
                "touched_in_single": ratios["single"][2],
                "drape_least": min(mean for mean, _ in drapes),
                "drape_mean": max(mean for mean, _ in drapes),
                "drape_worst": max(worst for _, worst in drapes),
            }
        )
    return rows
