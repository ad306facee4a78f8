"""Cost of a step with an obstacle, against the step without."""

from __future__ import annotations

from time import perf_counter
from typing import Any, get_args

import clothsim as cs
import numpy as np
from clothsim.typing import Precision
from timing import Steps, measure

_FRICTION = 0.3
_BALL = cs.Sphere((0.5, -5.01, 0.5), 5.0, offset="none")  # under a whole sheet
_FLOOR = cs.Plane((0.0, -0.1, 0.0))
_FALL = 40, 100, 2.5e-4  # parts of the paper's scene, steps of a part, the length of a step [s]


def _settled(obstacle: cs.Sphere | cs.Plane) -> cs.Stepper:
    """Return a sheet without pins that drag has brought to rest, all points on the obstacle."""
    cloth = cs.Cloth(drag=20.0, pins=())
    stepper = cs.Stepper(cs.Scene(cloth, obstacle), threads=1)
    stepper.advance(20_000, 1e-4)
    return stepper


def cost(windows: int = 60, steps: int = 40, dt: float = 5e-6) -> list[dict[str, Any]]:
    """Least time of a step over many short windows, the variants in turn.

    All 1,024 points of a sheet lie on a large sphere or on a plane, or nothing is near. The last
    rows are of whole runs: the paper's scene over 1 s at 2.5e-4 s, for a sixth of the windows. The
    ratio is to the step of the same cloth without obstacles, with as many threads.
    """
    far = cs.Sphere((0.5, -9.0, 0.5), 0.25)
    on_ball, on_floor = map(_settled, (_BALL, _FLOOR))
    variants: dict[str, tuple[Any, cs.Stepper]] = {
        "no obstacle": ((), on_ball),
        "sphere, nothing near": (far, on_ball),
        "sphere": (_BALL, on_ball),
        "sphere, friction": (_BALL.replace(friction=_FRICTION), on_ball),
        "plane": (_FLOOR, on_floor),
        "plane, friction": (_FLOOR.replace(friction=_FRICTION), on_floor),
    }
    falls: dict[str, Any] = {
        "the paper's cloth, no obstacle": (),
        "the paper's scene": cs.Sphere((0.5, -0.5, 0.5), 0.25),
    }
    rows = []
    for precision in get_args(Precision):
        for threads in (1, 2):
            options = {"threads": threads, "precision": precision}
            lying = [
                Steps(
                    cs.Stepper(
                        cs.Scene(cs.Cloth(pins=()), obstacles),
                        on.positions,
                        on.velocities,
                        **options,
                    ),
                    dt,
                    steps,
                )
                for obstacles, on in variants.values()
            ]
            of_lying = [timing.minimum for timing in measure(lying, windows)]
            falling = [cs.Scene(cs.Cloth(), obstacles) for obstacles in falls.values()]
            of_falling = _falls(falling, max(2, windows // 6), options)
            for names, seconds in ((variants, of_lying), (falls, of_falling)):
                rows += [
                    {
                        "precision": precision,
                        "threads": threads,
                        "variant": name,
                        "microseconds": 1e6 * duration,
                        "ratio": duration / seconds[0],
                    }
                    for name, duration in zip(names, seconds, strict=True)
                ]
    return rows


def _falls(scenes: list[cs.Scene], rounds: int, options: dict[str, Any]) -> list[float]:
    """Seconds per step of whole runs: least times of short parts, as a run meets other work."""
    parts, steps, dt = _FALL
    least = np.full((len(scenes), parts), np.inf)
    for _ in range(rounds):
        steppers = [cs.Stepper(scene, **options) for scene in scenes]
        for part in range(parts):
            for k, stepper in enumerate(steppers):
                start = perf_counter()
                stepper.advance(steps, dt)
                least[k, part] = min(least[k, part], perf_counter() - start)
    return (least.sum(axis=1) / (parts * steps)).tolist()
