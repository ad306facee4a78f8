"""Experiment 4 of Kim et al. over sizes: the core against the compute shader.

A run makes a stepper, times its first frames one by one, then takes the mean over a window of
frames. The first frames make buffers and pipelines, so the paper's first measurement is slower. A
window that exceeds its limit ends early and says after how many steps. A large cloth on a slow
target takes a step or two. `gpu_report.py` makes tables and plots of them; benchmarks/gpu.py is the
command.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

import clothsim as cs
from clothsim import gpu, machine
from clothsim.gpu import Adapter, adapters, using
from clothsim.scenes import PAPER_DT
from clothsim.typing import Precision

from ..base.clocks import StepTimer, Stopwatch
from . import paper_settings
from .published import METHODS

PAPER_SIZE = 32  # points along a side


SCALAR, SIMD, GPU = "scalar", "SIMD", "GPU"


@dataclass(frozen=True)
class Target:
    """Name of the target."""

    kind: str
    name: str
    threads: int = 1
    adapter: Adapter | None = None

    @property
    def software(self) -> bool:
        """Whether the target is a software adapter, which runs on the CPU."""
        return self.adapter is not None and self.adapter.software


@dataclass
class Measurement:
    """Result of one target with one scene."""

    target: Target
    method: int
    precision: Precision
    size: int
    members: int
    setup: list[float] = field(default_factory=list)  # s, per run
    first_frames: list[list[float]] = field(default_factory=list)  # s a step, per run and frame
    rates: list[float] = field(default_factory=list)  # steps/s, per run
    steps: list[int] = field(default_factory=list)  # in the window, per run
    frame_steps: int = 1
    asked: int = 0  # steps of a window that is not ended early
    limit: float = 0.0  # s after which one is
    bandwidth: float = 0.0  # of the target's memory [B/s]

    @property
    def points(self) -> int:
        return self.size * self.size * self.members

    @property
    def rate(self) -> float:
        """Median steps/s of the runs."""
        return float(np.median(self.rates))

    @property
    def shortened(self) -> bool:
        """Whether windows were ended early."""
        return min(self.steps) < self.asked

    def quartiles(self) -> tuple[float, float]:
        low, high = np.quantile(self.rates, (0.25, 0.75))
        return float(low), float(high)


@dataclass(frozen=True)
class Settings:
    """Sizes of the experiment."""

    sizes: tuple[int, ...] = (32, 64, 128, 256, 512, 1024, 2048, 4096)  # points along a side of a square cloth
    batches: tuple[int, ...] = (4, 16, 64, 256, 1024, 16384)  # numbers of cloths of `batch_size` points along a side
    batch_size: int = 32
    methods: tuple[int, ...] = (1, 2)
    precisions: tuple[Precision, ...] = ("single", "double")
    frame_steps: int = 320  # steps per frame
    window_frames: int = 200  # frames that one measurement averages over
    runs: int = 10  # measurements, each with a stepper of its own
    seconds: float = 1.0  # wall time after which a window ends early [s]
    paper_seconds: float = 10.0  # limit for the paper's own cloth of 32 x 32, whose frames are to be whole [s]
    first_frames: int = 8  # frames of a run that are timed one by one
    # Wall time after which a first frame ends early [s]. No further frame begins once the frames after the first have taken
    # four times this.
    first_seconds: float = 0.1

    def limit(self, size: int, members: int) -> float:
        """Wall time after which a window of such a scene ends early [s]."""
        return self.paper_seconds if (size, members) == (PAPER_SIZE, 1) else self.seconds


def touching_scene(size: int, method: int) -> tuple[cs.Scene, float]:
    """The paper's cloth, with more points, lying on its sphere; and a stable step [s].

    The sheet drapes over the sphere's cap, because points are moved straight up. About 7 % of them
    are in contact from the first step on, at any size.
    """
    radius, below = 0.25, 0.2
    sphere = cs.Sphere((0.5, -below, 0.5), radius, response=METHODS[method][0], offset="edge", restitution=1.0)
    cloth = cs.Cloth((size, size), springs=("structural", "shear"))
    x = np.array(cloth.rest_positions)
    horizontal = np.hypot(x[..., 0] - 0.5, x[..., 2] - 0.5)
    reach = sphere.contact_radius(cloth)
    top = np.sqrt(np.maximum(reach**2 - horizontal**2, 0.0)) - below
    x[..., 1] = np.maximum(x[..., 1], top)
    scene = cs.Scene(cloth, sphere, position=x)
    return scene, min(PAPER_DT, 0.5 * cs.max_stable_dt(scene))


def targets(precision: str, found: Sequence[Adapter] | None = None) -> list[Target]:
    """Everything that can step in `precision`, with the adapters found or all of this machine, and the scalar reference."""
    found = adapters() if found is None else found
    threads = int(cs.build_config()["openmp_threads"])
    result = [Target(SCALAR, "scalar, 1 thread" + " (double)" * (precision == "single"))]
    result += [Target(SIMD, f"SIMD, {n} thread{'s' * (n > 1)}", n) for n in sorted({1, threads})]
    result += [Target(GPU, a.name + " [a CPU]" * a.software, 1, a) for a in found if a.float64 or precision == "single"]
    return result


def _stepping(target: Target, scene: cs.Scene, members: int, precision: Precision, dt: float) -> Callable[..., Any]:
    """A function that does a number of steps."""
    x, v = scene.initial_position, scene.initial_velocity
    if target.kind == SCALAR:
        states = [(x, v)] * members

        def advance(steps: int) -> None:
            for k, state in enumerate(states):
                states[k] = cs.reference_step(scene, *state, dt, steps)

        return advance
    if members > 1:
        x, v = np.stack([x] * members), np.stack([v] * members)
    where: dict[str, Any] = {"backend": "gpu"} if target.kind == GPU else {"threads": target.threads}
    stepper = cs.Stepper(scene, x, v, precision=precision, **where)
    return lambda steps: stepper.advance(steps, dt)


def measure(measurement: Measurement, scene: cs.Scene, dt: float, settings: Settings) -> Measurement:
    """One more run of `measurement`."""
    m = measurement
    with using(m.target.adapter) if m.target.adapter else nullcontext():
        with Stopwatch() as setup:
            advance = _stepping(m.target, scene, m.members, m.precision, dt)
        m.setup.append(setup.seconds)
        timer, spent = StepTimer(advance), 0.0
        first: list[float] = []
        while len(first) < settings.first_frames and spent <= 4 * settings.first_seconds:
            done, elapsed = timer.timed(settings.frame_steps, settings.first_seconds)
            spent += elapsed if first else 0.0  # the first one may be compiling for seconds
            first.append(elapsed / done)
        m.first_frames.append(first)
        m.frame_steps, m.asked = settings.frame_steps, settings.window_frames * settings.frame_steps
        m.limit = settings.limit(m.size, m.members)
        done, elapsed = timer.timed(m.asked, m.limit)
    m.rates.append(done / elapsed)
    m.steps.append(done)
    return m


@cache
def memory_bandwidth(threads: int, adapter: Adapter | None) -> float:
    """Bytes per second that a target reads and writes in its memory."""
    if adapter is None:
        return machine.memory_bandwidth(threads)["update"]
    with using(adapter):
        return gpu.memory_bandwidth()


def cases(settings: Settings) -> list[tuple[int, int]]:
    """(size, members) of every scene."""
    return [(n, 1) for n in settings.sizes] + [(settings.batch_size, b) for b in settings.batches]


def run(
    settings: Settings | None = None,
    found: Sequence[Adapter] | None = None,
    *,
    advance: Callable[[int], Any] = lambda runs: None,
    finished: Callable[[list[Measurement]], Any] = lambda measurements: None,
    left_out: Callable[[Measurement, Exception], Any] = lambda measurement, why: None,
) -> list[Measurement]:
    """Measure every target with every scene, with the adapters `found` or all of this machine.

    The targets of a scene take turns, run by run, so that a slow spell of the machine affects all. `advance` is called with
    1 after each run. `finished` is called with all measurements so far after each scene, so that an interrupted experiment
    keeps them. `left_out` is called with each measurement that failed and its error: a limit was exceeded, memory was
    missing or an adapter was lost. These are missing in the result.
    """
    settings = settings or Settings()
    measurements: list[Measurement] = []
    for precision in settings.precisions:
        everyone = targets(precision, found)
        bandwidths = {t.name: memory_bandwidth(t.threads, t.adapter) for t in everyone}
        for size, members in cases(settings):
            for method in settings.methods:
                scene, dt = touching_scene(size, method)
                group = [Measurement(t, method, precision, size, members, bandwidth=bandwidths[t.name]) for t in everyone]
                for done in range(settings.runs):
                    for one in list(group):
                        try:
                            measure(one, scene, dt, settings)
                            advance(1)
                        except (MemoryError, ValueError, RuntimeError) as error:
                            group.remove(one)
                            left_out(one, error)
                            advance(settings.runs - done)
                measurements += group
                finished(measurements)
    return measurements


def count(settings: Settings, found: Sequence[Adapter] | None = None) -> int:
    """Runs that `run` makes at most."""
    everyone = sum(len(targets(p, found)) for p in settings.precisions)
    return everyone * len(cases(settings)) * len(settings.methods) * settings.runs


def available() -> tuple[list[Adapter], str]:
    """The adapters, and the reason if there is none."""
    try:
        found = adapters()
    except ImportError as error:
        return [], str(error)
    return found, "" if found else "this machine has no graphics adapter that wgpu can use"


def settings_of(settings: paper_settings.Settings) -> Settings:
    """The sizes that a reproduction with `settings` compares."""
    return Settings(
        sizes=settings.gpu_sizes,
        batches=settings.gpu_batches,
        precisions=("single",),
        frame_steps=settings.steps_per_frame(settings.timing_dt),
        window_frames=settings.window_frames,
        runs=settings.runs,
        seconds=settings.gpu_seconds,
        paper_seconds=4 * settings.gpu_seconds,
        first_seconds=settings.gpu_seconds / 4,
    )
