"""Experiments 1 and 2: a cloth in contact with a sphere, for each response.

Every combination of method (1, 2) and variant (as printed, corrected) steps one scene. At the
paper's frames the state is kept and measured. Between them, the deepest penetration of every frame
is recorded.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import product
from threading import Event
from typing import Any

import numpy as np

import clothsim as cs

from .paper_settings import Settings
from .published import METHODS, VARIANTS

NEAR = 1e-3  # m; a point this close to the contact radius counts as touching
LOST = 1e3  # m; a cloth that reaches so far is given up
HISTORY_POINTS = 200  # entries kept of the frame-by-frame record
PLAYED = 200  # states kept to be played; a page of four such runs is some 3 MB


@dataclass(frozen=True)
class Experiment:
    """One of the two contact experiments."""

    number: str
    title: str
    table: str
    scene: Callable[..., cs.Scene]
    frames: Sequence[int]
    dt: float


@dataclass
class Case:
    """One method in one variant, and its results."""

    method: int
    variant: str
    cells: list[dict[str, Any]] = field(default_factory=list)
    states: dict[int, tuple[np.ndarray, float]] = field(default_factory=dict)
    history: dict[str, list[float]] = field(default_factory=dict)
    played: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    failure: str | None = None


def experiment(number: str, settings: Settings) -> Experiment:
    """Experiment "1" (static sphere, Table 3) or "2" (moving sphere, Table 4)."""
    title = "{} sphere, method 1 against method 2"
    if number == "1":
        frames, dt = settings.static_frames, settings.static_dt
        return Experiment("1", title.format("Static"), "table3", cs.scenes.paper_static, frames, dt)
    frames, dt = settings.moving_frames, settings.moving_dt
    return Experiment("2", title.format("Moving"), "table4", cs.scenes.paper_moving, frames, dt)


def scene_of(experiment: Experiment, method: int, variant: str) -> cs.Scene:
    """The experiment's scene with the response of `method`, as printed or corrected."""
    return experiment.scene(response=METHODS[method][0], as_printed=variant == "as printed")


def run(
    experiment: Experiment,
    settings: Settings,
    *,
    threads: int = 1,
    variants: Sequence[str] = tuple(VARIANTS),
    advance: Callable[[int], object] = lambda frames: None,
) -> list[Case]:
    """Step both methods in every variant, `threads` of these cases at a time, each on one thread of the core.

    `advance` is called with the number of new frames. The cases are in the order of `variants` and `published.METHODS`.
    """
    cases = [Case(method, variant) for variant, method in product(variants, METHODS)]
    stop = Event()
    # A step a frame, one of the readings studied, is above the guarantee; the report says so itself.
    with warnings.catch_warnings(), ThreadPoolExecutor(max_workers=threads) as pool:
        warnings.simplefilter("ignore", cs.StabilityWarning)
        try:
            list(pool.map(lambda case: _run(experiment, settings, case, advance, stop), cases))
        finally:  # Ctrl-C reaches this thread only
            stop.set()
    return cases


def _run(experiment: Experiment, settings: Settings, case: Case, advance: Callable[[int], object], stop: Event) -> None:
    scene = scene_of(experiment, case.method, case.variant)
    sphere = scene.spheres[0]
    steps = settings.steps_per_frame(experiment.dt)
    stepper = cs.Stepper(scene, threads=1)
    start = float(cs.energy(scene, scene.initial_position, scene.initial_velocity)["total"])
    deepest = {"points": 0.0, "triangles": 0.0}
    record = []
    every = -(-max(experiment.frames) // PLAYED)
    case.played.append((0.0, scene.initial_position, scene.initial_velocity))
    for frame in range(1, max(experiment.frames) + 1):
        if stop.is_set():
            return
        case.failure = _advance(stepper, steps, experiment.dt)
        if case.failure:
            advance(max(experiment.frames) + 1 - frame)
            break
        positions = stepper.positions
        depth = cs.penetration(positions, sphere, stepper.time)
        deepest = {name: max(deepest[name], float(depth[name])) for name in deepest}
        energy = {name: float(value) for name, value in cs.energy(scene, positions, stepper.velocities).items()}
        gained = energy["total"] - start
        record.append((frame, depth["points"], depth["triangles"], gained))
        advance(1)
        if frame % every == 0 or frame in experiment.frames:
            velocities = stepper.velocities.copy()
            case.played.append((float(stepper.time), positions.copy(), velocities))
        if frame in experiment.frames:
            case.states[frame] = positions.copy(), stepper.time
            case.cells.append(
                {
                    "method": case.method,
                    "variant": case.variant,
                    "frame": frame,
                    "time": float(stepper.time),
                    "penetration": {name: float(depth[name]) for name in deepest},
                    "deepest_so_far": deepest,
                    "points_touching": _touching(positions, scene, stepper.time),
                    "energy_gained": gained,
                    "energy": energy,
                }
            )
    case.history = _thinned(record)


def _advance(stepper: cs.Stepper, steps: int, dt: float) -> str | None:
    """Advance, and return the text of the error if there is one."""
    try:
        stepper.advance(steps, dt)
    except cs.UnstableError as error:
        return str(error)
    if np.abs(stepper.positions).max() > LOST:
        return f"points are more than {LOST:g} m away at t = {stepper.time:g} s"
    return None


def _touching(positions: np.ndarray, scene: cs.Scene, time: float) -> int:
    sphere = scene.spheres[0]
    distance = np.linalg.norm(positions - sphere.center_at(time), axis=-1)
    return int(np.sum(distance < sphere.contact_radius(scene.cloth) + NEAR))


def step_study(experiment: Experiment, settings: Settings, *, threads: int = 1) -> list[dict[str, Any]]:
    """Both methods as printed, at each of `settings.study_dts`; "penetration" frame by frame."""
    rows = []
    for dt in settings.study_dts:
        coarse = replace(experiment, dt=dt)
        for case in run(coarse, settings, threads=threads, variants=("as printed",)):
            if not case.failure:
                rows.append(
                    {
                        "dt": dt,
                        "method": case.method,
                        "penetration": [cell["penetration"] for cell in case.cells],
                        "energy_gained": case.cells[-1]["energy_gained"],
                    }
                )
    return rows


def _thinned(record: list[tuple[Any, ...]]) -> dict[str, list[float]]:
    """At most HISTORY_POINTS entries: the deepest of each stretch of frames, the last energy."""
    names = ("frame", "points", "triangles", "energy_gained")
    if not record:
        return {name: [] for name in names}
    stretches = np.array_split(np.array(record, float), min(HISTORY_POINTS, len(record)))
    rows = [(s[-1, 0], s[:, 1].max(), s[:, 2].max(), s[-1, 3]) for s in stretches]
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}
