"""Experiments 1 to 4 of Kim et al.: two contact experiments in four cases each, and two of speed."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from threading import Event
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.gpu import adapters, using
from clothsim.scenes import PAPER_DT
from clothsim.typing import Precision, Response

from ..base.clocks import Stopwatch

METHODS: dict[int, Response] = {1: "reflect", 2: "ray"}
VARIANTS = {
    "as printed": "the sphere's own velocity is ignored, and every point found inside is reflected, also one that leaves",
    "corrected": "velocities are relative to the sphere, and only approaching points are reflected",
}
FRAMES = {"1": (150, 500, 800), "2": (200, 1300, 3100)}  # of Tables 3 and 4
NEAR = 1e-3  # m; a point this close to the contact radius counts as touching
LOST = 1e3  # m; a cloth that reaches so far is given up
PLAYED = 200  # states kept to be played; a page of four such runs is some 3 MB
AGREEMENT_STEPS = 100  # after which experiment 4 compares core and reference


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiments; `docs/reproduction.md` says why a frame is 1.6 ms.

    Parameters
    ----------
    dt : tuple of float
        Integration steps of experiments 1, 2, and 3 and 4 [s]. The cost of a step does not depend on it.
    frame_dt : float
        Time between two frames [s].
    study_dts : tuple of float
        Coarser steps for repeats of experiment 1 as printed [s]. The last is one step per frame.
    runs, windows, window_frames : int
        Repeats of a timed run; windows of so many frames in a run of experiment 3.
    speedup_steps : int
        Steps in one measurement of experiment 4.
    part : float
        Part of its scenes' durations that experiment 5 runs.
    picture_width : int
        Pixels along a picture.
    """

    dt: tuple[float, float, float] = (PAPER_DT, PAPER_DT, PAPER_DT)
    frame_dt: float = 1.6e-3
    study_dts: tuple[float, ...] = (1e-4, 4e-4, 1.6e-3)
    runs: int = 10
    windows: int = 4
    window_frames: int = 200
    speedup_steps: int = 20_000
    part: float = 1.0
    picture_width: int = 520

    def steps_per_frame(self, dt: float = PAPER_DT) -> int:
        """Steps of `dt` that one frame takes."""
        steps = round(self.frame_dt / dt)
        if steps < 1 or abs(steps * dt - self.frame_dt) > 1e-9 * self.frame_dt:
            raise ValueError(f"frame_dt must be a whole number of steps of {dt!r} s, got {self.frame_dt!r} s")
        return steps

    def cuts(self) -> list[str]:
        """What these settings cut from the full reproduction, one line each."""
        full, lines = Settings(), []
        for what, dt in zip(("experiment 1", "experiment 2", "experiments 3 and 4"), self.dt, strict=True):
            if dt != PAPER_DT:
                lines.append(f"{what}: steps of {dt:g} s instead of {PAPER_DT:g} s")
        words = {
            "runs": "repeats of a timed run",
            "windows": "windows a run in experiment 3",
            "window_frames": "frames a window in experiment 3",
            "speedup_steps": "steps a run in experiment 4",
            "part": "part of its scenes' durations that experiment 5 runs",
        }
        for name, what in words.items():
            if getattr(self, name) < getattr(full, name):
                lines.append(f"{what}: {getattr(self, name)} instead of {getattr(full, name)}")
        return lines


FULL = Settings()
QUICK = Settings(dt=(2e-5, 5e-5, 5e-5), runs=3, windows=2, window_frames=100, speedup_steps=500, part=0.4, picture_width=400)


@dataclass
class Case:
    """One method in one variant: results at the table's frames ("cells"), the deepest of every frame, states to play."""

    method: int
    variant: str
    scene: cs.Scene
    cells: list[dict[str, Any]] = field(default_factory=list)
    history: list[tuple[int, float, float]] = field(default_factory=list)  # frame, triangle depth [m], energy gained [J]
    played: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    states: dict[int, tuple[np.ndarray, float]] = field(default_factory=dict)
    failure: str = ""

    @property
    def name(self) -> str:
        return f"method {self.method}, {self.variant}"


class Passed:
    """Counts mass points that go through the sphere: between two states seen, or out on another side than they came in."""

    def __init__(self, scene: cs.Scene) -> None:
        self._sphere, self.count = scene.spheres[0], 0
        self._from_center = scene.initial_position - self._sphere.center_at(0.0)
        self._entered = self._from_center

    def see(self, x: np.ndarray, t: float) -> None:
        before, after, radius = self._from_center, x - self._sphere.center_at(t), self._sphere.radius
        was_outside, is_outside = (np.linalg.norm(p, axis=-1) >= radius for p in (before, after))
        entered, left = was_outside & ~is_outside, ~was_outside & is_outside
        self._entered = np.where(entered[..., None], before, self._entered)
        way = after - before  # straight, in the sphere's frame
        length2 = (way * way).sum(axis=-1)
        part = np.clip(-(before * way).sum(axis=-1) / np.where(length2 > 0, length2, 1), 0, 1)
        nearest = np.linalg.norm(before + part[..., None] * way, axis=-1)
        between = was_outside & is_outside & (nearest < radius * (1 - 1e-9))
        turned = left & ((self._entered * after).sum(axis=-1) < 0)
        self.count += int((between | turned).sum())
        self._from_center = after


def scene_of(number: str, method: int, variant: str) -> cs.Scene:
    """The scene of experiment "1" (static sphere) or "2" (moving sphere)."""
    make = cs.scenes.paper_static if number == "1" else cs.scenes.paper_moving
    return make(response=METHODS[method], as_printed=variant == "as printed")


def contact(
    number: str,
    settings: Settings,
    dt: float,
    threads: int = 1,
    variants: Sequence[str] = tuple(VARIANTS),
    advance: Callable[[int], object] = lambda frames: None,
) -> list[Case]:
    """Step both methods in the variants, `threads` of these cases at a time, each on one thread of the core.

    `advance` is called with the number of new frames.
    """
    cases = [Case(method, variant, scene_of(number, method, variant)) for variant, method in product(variants, METHODS)]
    stop = Event()
    # A step a frame, one of the readings studied, is above the guarantee; the report says so itself.
    with warnings.catch_warnings(), ThreadPoolExecutor(max_workers=threads) as pool:
        warnings.simplefilter("ignore", cs.StabilityWarning)
        try:
            list(pool.map(lambda case: _run(case, FRAMES[number], settings, dt, advance, stop), cases))
        finally:  # Ctrl-C reaches this thread only
            stop.set()
    return cases


def _run(
    case: Case, frames: Sequence[int], settings: Settings, dt: float, advance: Callable[[int], object], stop: Event
) -> None:
    scene, sphere = case.scene, case.scene.spheres[0]
    stepper = cs.Stepper(scene, threads=1)
    start = cs.energy(scene, scene.initial_position, scene.initial_velocity)["total"]
    passed, every, steps = Passed(scene), -(-max(frames) // PLAYED), settings.steps_per_frame(dt)
    case.played.append((0.0, scene.initial_position, scene.initial_velocity))
    for frame in range(1, max(frames) + 1):
        if stop.is_set():
            return
        try:
            stepper.advance(steps, dt)
        except cs.UnstableError as error:
            case.failure = str(error)
            return
        x, v, t = stepper.positions, stepper.velocities, float(stepper.time)
        if np.abs(x).max() > LOST:
            case.failure = f"points are more than {LOST:g} m away at t = {t:g} s"
            return
        depth, energy = dict(cs.penetration(x, sphere, t)), dict(cs.energy(scene, x, v))
        passed.see(x, t)
        case.history.append((frame, float(depth["triangles"]), float(energy["total"] - start)))
        advance(1)
        if frame % every == 0 or frame in frames:
            case.played.append((t, x.copy(), v.copy()))
        if frame in frames:
            case.states[frame] = x.copy(), t
            distance = np.linalg.norm(x - sphere.center_at(t), axis=-1)
            case.cells.append(
                {"method": case.method, "variant": case.variant, "frame": frame, "time": t, "penetration": depth}
                | {"deepest_so_far": max(d for _, d, _ in case.history), "points_passed": passed.count}
                | {"points_touching": int((distance < sphere.contact_radius(scene.cloth) + NEAR).sum())}
                | {"energy_gained": energy["total"] - start, "energy": energy}
            )


def study(settings: Settings, threads: int) -> list[dict[str, Any]]:
    """Experiment 1 as printed at each of `settings.study_dts`; depths frame by frame."""
    return [
        {
            "dt": dt,
            "method": case.method,
            "penetration": [cell["penetration"] for cell in case.cells],
            "energy_gained": case.cells[-1]["energy_gained"],
        }
        for dt in settings.study_dts
        for case in contact("1", settings, dt, threads, ("as printed",))
        if not case.failure
    ]


def _rates(steps: int, seconds: Any, frame_steps: int) -> dict[str, float]:
    """Median and quartiles over runs, as rates: one disturbed run moves neither."""
    upper, middle, lower = steps / np.quantile(seconds, (0.25, 0.5, 0.75))
    return {
        "steps_per_second": float(middle),
        "lower_quartile": float(lower),
        "upper_quartile": float(upper),
        "microseconds_per_step": float(1e6 / middle),
        "frames_per_second": float(middle / frame_steps),
    }


def frame_rates(settings: Settings, advance: Callable[[int], object] = lambda runs: None) -> dict[str, Any]:
    """Experiment 3: both methods on the falling cloth, on one thread, in turns; rates over windows of frames.

    A frame is its steps and one copy of the positions, as a renderer needs.
    """
    dt = settings.dt[2]
    steps, frame_steps = settings.steps_per_frame(dt), settings.steps_per_frame()
    seconds = {method: np.empty((settings.runs, settings.windows)) for method in METHODS}
    for run in range(settings.runs):
        for method, response in METHODS.items():
            stepper = cs.Stepper(cs.scenes.paper_static(response=response), threads=1)
            for window in range(settings.windows):
                with Stopwatch() as watch:
                    for _ in range(settings.window_frames):
                        stepper.advance(steps, dt)
                        stepper.positions  # noqa: B018
                seconds[method][run, window] = watch.seconds
            advance(1)
    timed, rows = steps * settings.window_frames, []
    for method, measured in seconds.items():
        windows = [{"window": str(w + 1), **_rates(timed, measured[:, w], frame_steps)} for w in range(settings.windows)]
        rows += [{"method": method, **w} for w in (*windows, {"window": "all", **_rates(timed, measured, frame_steps)})]
    return {"rows": rows, "frame_steps": frame_steps}


def speedup(settings: Settings, threads: int, advance: Callable[[int], object] = lambda runs: None) -> dict[str, Any]:
    """Experiment 4: method 2 by the scalar reference, the core and every graphics adapter, from one state in contact."""
    dt, steps = settings.dt[2], settings.speedup_steps
    scene = cs.scenes.paper_static(response="ray")
    x, v = cs.step(scene, scene.initial_position, scene.initial_velocity, 5e-5, 10_000)
    t = 0.5

    def core(precision: Precision, threads: int | None = None, adapter: Any = None) -> tuple[float, float]:
        def measure() -> tuple[float, float]:
            backend: Any = {"backend": "gpu"} if adapter else {"threads": threads}
            with Stopwatch() as first:
                stepper = cs.Stepper(scene, x, v, t=t, precision=precision, **backend)
                stepper.advance(1, dt)
            with Stopwatch() as watch:
                stepper.advance(steps, dt)
            return first.seconds, watch.seconds

        if adapter is None:
            return measure()
        with using(adapter):
            return measure()

    def reference() -> tuple[float, float]:
        with Stopwatch() as watch:
            cs.reference_step(scene, x, v, dt, steps=steps, t=t)
        return 0.0, watch.seconds

    variants: dict[tuple[str, str, int], Callable[[], tuple[float, float]]] = {("scalar reference", "double", 1): reference}
    for precision in ("double", "single"):
        for count in sorted({1, threads}):
            variants["SIMD core", precision, count] = lambda p=precision, c=count: core(p, c)  # type: ignore[misc]
    try:
        found, missing = adapters(), "this machine has no graphics adapter"
    except ImportError as error:
        found, missing = [], str(error)
    for one in found:
        for precision in ("double", "single") if one.float64 else ("single",):
            name = f"shader, {one.name}{' [a CPU]' if one.software else ''}"
            variants[name, precision, 1] = lambda p=precision, a=one: core(p, adapter=a)  # type: ignore[misc]
    measured: dict[tuple[str, str, int], list[tuple[float, float]]] = {key: [] for key in variants}
    for _ in range(settings.runs):
        for key, measure in variants.items():
            measured[key].append(measure())
            advance(1)
    rows: list[dict[str, Any]] = []
    for (kind, precision, count), pairs in measured.items():
        first, seconds = np.array(pairs).T
        row = {"kind": kind, "precision": precision, "threads": count, **_rates(steps, seconds, settings.steps_per_frame())}
        row["speedup"] = row["steps_per_second"] / (rows or [row])[0]["steps_per_second"]
        rows.append({**row, "first_step_seconds": float(np.median(first)), "runs": (steps / seconds).tolist()})
    ends = cs.reference_step(scene, x, v, dt, steps=AGREEMENT_STEPS, t=t), cs.step(scene, x, v, dt, AGREEMENT_STEPS, t=t)
    agreement = float(np.abs(ends[0][0] - ends[1][0]).max())
    return {"rows": rows, "agreement": agreement, "gpu": [a.name for a in found if not a.software], "gpu_missing": missing}
