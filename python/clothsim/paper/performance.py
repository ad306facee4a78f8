"""Experiments 3 and 4: steps and frames per second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import clothsim as cs
from clothsim.gpu import Adapter, adapters, using
from clothsim.scenes import PAPER_DT
from clothsim.typing import Backend, Precision

from ..base.clocks import StepTimer, Stopwatch
from .paper_settings import Settings
from .published import METHODS

REFERENCE = "scalar reference"
CORE = "SIMD core"
SHADER = "shader"
WARM_UP = 0.5  # s stepped before experiment 4 is timed, so that the cloth lies on the sphere
WARM_UP_DT = 5e-5  # s
AGREEMENT_STEPS = 100
PRECISIONS: tuple[Precision, ...] = ("double", "single")
Measure = Callable[[], tuple[float, float]]  # set-up time [s] and steps/s
Variant = tuple[str, Precision, int]  # kind, precision, threads
Start = tuple[cs.Scene, np.ndarray, np.ndarray]  # scene, positions, velocities


def _statistics(seconds_per_step: np.ndarray, frame_steps: int) -> dict[str, Any]:
    """Median and quartiles over runs, as rates: one disturbed run moves neither."""
    upper, middle, lower = 1.0 / np.quantile(seconds_per_step, (0.25, 0.5, 0.75))
    return {
        "steps_per_second": float(middle),
        "lower_quartile": float(lower),
        "upper_quartile": float(upper),
        "microseconds_per_step": float(1e6 / middle),
        "frames_per_second": float(middle / frame_steps),
    }


def methods(settings: Settings, *, advance: Callable[..., Any] = lambda runs: None) -> dict[str, Any]:
    """Experiment 3: both methods on the falling cloth, each run in windows of frames.

    Runs use one thread, which disturbs the comparison least. Experiment 4 shows the gain by threads. The runs of the
    two alternate, so that a slow spell of the machine meets both. A frame is its steps and one copy of the positions,
    as a renderer needs. `advance` is called with 1 after each run. "rows" has one entry a method with its rates over all
    windows and "windows", the same window by window; "frame_steps" are the steps in a frame at the paper's step.
    """
    steps = settings.steps_per_frame(settings.timing_dt)
    frame_steps = settings.steps_per_frame(PAPER_DT)
    seconds = {method: np.empty((settings.runs, settings.windows)) for method in METHODS}
    for run in range(settings.runs):
        for method, (response, _) in METHODS.items():
            stepper = cs.Stepper(cs.scenes.paper_static(response=response), threads=1)
            for window in range(settings.windows):
                with Stopwatch() as watch:
                    for _ in range(settings.window_frames):
                        stepper.advance(steps, settings.timing_dt)
                        stepper.positions  # noqa: B018
                seconds[method][run, window] = watch.seconds
            advance(1)
    rows = []
    for method, measured in seconds.items():
        per_step = measured / (settings.window_frames * steps)
        windows = [_statistics(per_step[:, w], frame_steps) for w in range(settings.windows)]
        rows.append({"method": method, **_statistics(per_step, frame_steps), "windows": windows})
    return {"rows": rows, "frame_steps": frame_steps, "threads": 1}


def available_adapters() -> tuple[list[Adapter], str]:
    """The graphics adapters, and the reason if there is none."""
    try:
        found = adapters()
    except ImportError as error:
        return [], str(error)
    return found, "" if found else "this machine has no graphics adapter that wgpu can use"


def speedup(
    settings: Settings, *, threads: int, adapters: Sequence[Adapter] = (), advance: Callable[..., Any] = lambda runs: None
) -> dict[str, Any]:
    """Experiment 4: method 2 by the SIMD core, the scalar spring-by-spring reference, and the shader on some adapters.

    `threads` are those of the core in the rows that use more than one. `advance` is called with 1 after each run. "rows" has
    one entry per variant with its rates, "speedup" over the reference, "setup_seconds" (making the stepper and its first
    step) and "runs" (steps/s). "agreement" is the largest difference of positions [m] to the reference after
    "agreement_steps".
    """
    scene = cs.scenes.paper_static(response="ray")
    stepper = cs.Stepper(scene, threads=1)
    stepper.advance(round(WARM_UP / WARM_UP_DT), WARM_UP_DT)
    start = stepper.positions.copy(), stepper.velocities.copy()
    t = stepper.time
    variants = _variants(settings, (scene, *start), t, threads, adapters)
    measured: dict[Variant, list[tuple[float, float]]] = {key: [] for key in variants}
    for _ in range(settings.runs):
        for key, measure in variants.items():
            measured[key].append(measure())
            advance(1)

    frame_steps = settings.steps_per_frame(PAPER_DT)
    rows: list[dict[str, Any]] = []
    for (kind, precision, count), pairs in measured.items():
        setup, rates = np.array(pairs).T
        row: dict[str, Any] = {"kind": kind, "precision": precision, "threads": count}
        row |= _statistics(1.0 / rates, frame_steps)
        row["speedup"] = row["steps_per_second"] / (rows or [row])[0]["steps_per_second"]
        row["setup_seconds"] = float(np.median(setup))
        row["first_setup_seconds"] = float(setup[0])
        row["runs"] = rates.tolist()
        rows.append(row)

    dt = settings.timing_dt
    expected, _ = cs.reference_step(scene, *start, dt, steps=AGREEMENT_STEPS, t=t)
    stepper = cs.Stepper(scene, *start, t=t, threads=threads)
    stepper.advance(AGREEMENT_STEPS, dt)
    difference = float(np.abs(stepper.positions - expected).max())
    return {"rows": rows, "frame_steps": frame_steps, "agreement": difference, "agreement_steps": AGREEMENT_STEPS}


def _variants(
    settings: Settings, start: Start, t: float, threads: int, adapters: Sequence[Adapter]
) -> dict[Variant, Measure]:
    """Measures by what is compared, the reference first. Each steps from the state `start` at the time `t`."""
    dt, steps = settings.timing_dt, settings.speedup_steps

    def timed(advance: Callable[[int], Any]) -> float:
        """Steps/s; ends early where threads wait for a busy processor and hardly get on."""
        done, elapsed = StepTimer(advance).timed(steps, settings.speedup_seconds)
        return done / elapsed

    def core(precision: Precision, threads: int | None, backend: Backend = "cpu") -> Measure:
        def measure() -> tuple[float, float]:
            with Stopwatch() as setup:
                stepper = cs.Stepper(*start, t=t, precision=precision, threads=threads, backend=backend)
                stepper.advance(1, dt)
            return setup.seconds, timed(lambda part: stepper.advance(part, dt))

        return measure

    def shader(precision: Precision, adapter: Adapter) -> Measure:
        def measure() -> tuple[float, float]:
            with using(adapter):
                return core(precision, None, backend="gpu")()

        return measure

    def reference() -> tuple[float, float]:
        with Stopwatch() as setup:
            cs.reference_step(*start, dt, steps=1, t=t)
        return setup.seconds, timed(lambda part: cs.reference_step(*start, dt, steps=part, t=t))

    variants: dict[Variant, Measure] = {(REFERENCE, "double", 1): reference}
    for precision in PRECISIONS:
        for count in sorted({1, threads}):
            variants[CORE, precision, count] = core(precision, count)
    for adapter in adapters:
        name = f"{SHADER}, {adapter.name}{' [a CPU]' if adapter.software else ''}"
        for precision in PRECISIONS if adapter.float64 else PRECISIONS[1:]:
            variants[name, precision, 1] = shader(precision, adapter)
    return variants
