"""What the bench measures: each function times one group of works and returns its figures."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import clothsim as cs

from .. import plan
from . import works
from .figures import Figure, Figures
from .numpy_peer import NumpyPeer
from .settings import PAPER_DT, Settings
from .timing import measure
from .works import Start

DTYPES = {"single": np.float32, "double": np.float64}
PRECISIONS = ("single", "double")
_IN_TURN = 1024  # rows of a grid of which a state for each work fits into memory


@dataclass(frozen=True)
class Bench:
    """What a run is made of: its size, the machine's choices, and where figures go."""

    settings: Settings
    figures: Figures
    kernels: tuple[str, ...]
    instruction_sets: tuple[str, ...]
    threads: tuple[int, ...]
    numba: bool
    advance: Callable[[int], object]

    @property
    def best(self) -> str:
        return self.instruction_sets[0]

    def core(self, start: Start, make: type = works.Core, **options: Any) -> Candidate:
        options = {"strict": False, "instruction_set": self.best, **options}
        return Candidate(start, partial(make, start, **options), options)

    def peer(self, start: Start, make: Callable[[], Any], **labels: Any) -> Candidate:
        return Candidate(start, make, {"instruction_set": "", "strict": False, **labels})


@dataclass(frozen=True)
class Candidate:
    """A work still to be made, and its labels."""

    start: Start
    make: Callable[[], Any]
    labels: dict[str, Any]


def run(
    bench: Bench,
    candidates: Sequence[Candidate],
    error_steps: int = 0,
    large: bool = False,
    longer: int = 1,
) -> None:
    """Time the candidates in turn and add their figures, with their errors if asked for.

    Windows are `longer` times as long as others, and as many times fewer.
    """
    made = [candidate.make() for candidate in candidates]
    settings = bench.settings
    windows = max(1, (settings.large_windows if large else settings.windows) // longer)
    timings = measure(made, windows, longer * settings.seconds, advance=bench.advance)
    errors: list[float | None] = [None] * len(made)
    flops = [getattr(work, "flops", None) for work in made]
    del made
    if error_steps:
        errors = _errors(candidates, error_steps)
    for candidate, timing, error, count in zip(candidates, timings, errors, flops, strict=True):
        start = candidate.start
        cloth = start.one.cloth
        bench.figures.add(
            [
                Figure(
                    work=start.name,
                    points=cloth.rows * cloth.columns,
                    springs=cloth.spring_count(),
                    minimum=timing.minimum / start.members,
                    median=timing.median / start.members,
                    windows=timing.windows,
                    steps=timing.steps,
                    error=error,
                    error_steps=error_steps or None,
                    flops=count,
                    **candidate.labels,
                )
            ]
        )


def _errors(candidates: Sequence[Candidate], steps: int) -> list[float | None]:
    """Largest distance to the double reference after `steps` steps from the start, for each."""
    expected: dict[str, np.ndarray] = {}
    errors: list[float | None] = []
    for candidate in candidates:
        start = candidate.start
        if start.name not in expected:
            expected[start.name], _ = cs.reference_step(
                start.one, start.x, start.v, PAPER_DT, steps, start.t
            )
        if candidate.labels["by"] == "reference":
            errors.append(None)
            continue
        work = candidate.make()
        work.prepare()
        work.run(steps)
        distance = np.linalg.norm(work.positions - expected[start.name], axis=-1)
        errors.append(float(distance.max()))
        del work
    return errors


def _numba(bench: Bench, start: Start, kind: str, precision: str, threads: int) -> Candidate:
    from . import numba_peer

    make = {"numba gather": numba_peer.NumbaGather, "numba strided": numba_peer.NumbaStrided}[kind]
    return bench.peer(
        start,
        partial(make, start.scene, start.x, start.v, PAPER_DT, DTYPES[precision], threads),
        by=kind,
        precision=precision,
        threads=threads,
    )


def steps(bench: Bench) -> None:
    """The paper's cloth by every kernel, precision, thread count, instruction set, and peer."""
    candidates = []
    for bend in (False, True):
        for sphere in (False, True):
            start = works.paper(bend, sphere)
            candidates += [
                bench.core(start, by=kernel, precision=precision, threads=threads)
                for kernel in bench.kernels
                for precision in PRECISIONS
                for threads in (*bench.threads, None)
                if threads is not None or not sphere
            ]
        start = works.contact(bend)
        candidates += [
            bench.core(start, by=kernel, precision=precision, threads=threads)
            for kernel in bench.kernels
            for precision in PRECISIONS
            for threads in bench.threads
        ]
        start = works.paper(bend, False)
        candidates += [
            bench.core(start, by=kernel, precision=precision, threads=1, instruction_set=name)
            for kernel in bench.kernels
            for precision in PRECISIONS
            for name in bench.instruction_sets[1:]
        ]
        candidates.append(
            bench.peer(
                start,
                partial(works.Reference, start),
                by="reference",
                precision="double",
                threads=1,
            )
        )
        for precision in PRECISIONS:
            make = partial(NumpyPeer, start.one, start.x, start.v, PAPER_DT, DTYPES[precision])
            candidates.append(bench.peer(start, make, by="numpy", precision=precision, threads=1))
    start = works.paper(True, False)
    candidates += [
        bench.core(start, by="gather", precision=precision, threads=1, strict=True)
        for precision in PRECISIONS
    ]
    if bench.numba:
        candidates += [
            _numba(bench, start, kind, precision, threads)
            for kind in ("numba gather", "numba strided")
            for precision in PRECISIONS
            for threads in bench.threads
            if threads == 1 or kind == "numba gather" or bench.settings.numba_parallel
        ]
    # Errors in contact say how a contact magnifies rounding, not how good the kernel is.
    smooth = [c for c in candidates if not c.start.name.startswith("contact")]
    run(bench, smooth, bench.settings.error_steps)
    run(bench, [c for c in candidates if c not in smooth])


def features(bench: Bench) -> None:
    """The price of each feature, on one thread."""
    base = works.paper(True, False)
    cloth = base.one.cloth
    rng = np.random.default_rng(0)
    sphere = cs.scenes.paper_static().spheres[0]
    families = {f: tuple(g for g in cloth.families if g != f) for f in cloth.families}
    cloths = {
        "all springs, damped": cloth,
        "no structural": cloth.replace(springs=families["structural"]),
        "no shear": cloth.replace(springs=families["shear"]),
        "no bend": cloth.replace(springs=families["bend"]),
        "no damping": cloth.replace(damping=0.0),
        "point damping": cloth.replace(damping=0.5, damping_model="point"),
        "structural only": cloth.replace(springs=("structural",)),
        "structural, undamped": cloth.replace(springs=("structural",), damping=0.0),
        "mass per point": cloth.replace(mass=rng.uniform(0.4, 0.6, cloth.shape)),
    }
    starts = [_like(base, name, cloth=changed) for name, changed in cloths.items()]
    for count, name in ((1, "1 sphere, far"), (4, "4 spheres, far")):
        far = tuple(sphere.replace(center=(0.5, -9.0 - i, 0.5)) for i in range(count))
        starts.append(_like(base, name, spheres=far))
    starts.append(Start("feature: on a sphere", *_state(works.contact(True))))
    run(
        bench,
        [
            bench.core(start, by=kernel, precision=precision, threads=1)
            for start in starts
            for kernel in bench.kernels
            for precision in PRECISIONS
        ],
    )


def _state(start: Start) -> tuple[Any, ...]:
    return start.scene, start.x, start.v, start.t


def _like(base: Start, name: str, **changes: Any) -> Start:
    scene = base.one.replace(**changes)
    return Start(f"feature: {name}", scene, base.x, base.v, base.t)


def batch(bench: Bench) -> None:
    """64 cloths in one call, long enough that each is stepped several times while in cache."""
    start = works.batch()
    candidates = [
        bench.core(start, by=kernel, precision=precision, threads=threads)
        for kernel in bench.kernels
        for precision in PRECISIONS
        for threads in bench.threads
    ]
    if bench.numba and bench.settings.numba_parallel:
        candidates += [
            _numba(bench, start, "numba strided", precision, threads)
            for precision in PRECISIONS
            for threads in bench.threads
        ]
    run(bench, candidates, longer=8)


def grids(bench: Bench) -> None:
    """Square grids of growing size, one after the other to keep memory small.

    A grid's works take turns, so that none is timed in one bad moment alone, unless the grid is
    so large that their states may not all fit.
    """
    for rows in bench.settings.sizes:
        start = works.grid(rows)
        counts = (*bench.threads, None) if rows <= 128 else bench.threads
        candidates = [
            bench.core(start, by=kernel, precision=precision, threads=threads)
            for kernel in bench.kernels
            for precision in PRECISIONS
            for threads in counts
        ]
        if bench.numba and rows in bench.settings.numba_sizes:
            candidates += [
                _numba(bench, start, "numba strided", precision, max(bench.threads))
                for precision in PRECISIONS
            ]
        if rows > _IN_TURN:
            for candidate in candidates:
                run(bench, [candidate], large=True)
                gc.collect()
        else:
            run(bench, candidates, error_steps=20 if rows <= 256 else 0)


def frames(bench: Bench) -> None:
    """A step a frame of 800 x 800, with and without the positions copied out; steps after a pause."""
    start = works.grid(800)
    copied = Start("frame 800", *_state(start))
    candidates = []
    for kernel in bench.kernels:
        options = {"by": kernel, "precision": "single", "threads": max(bench.threads)}
        candidates += [
            bench.core(start, works.Calls, **options),
            bench.core(copied, works.Frames, **options),
        ]
    run(bench, candidates)
    pause = f"{1e3 * works.Paused.PAUSE:.0f} ms"
    paused = Start(f"frame 32 after {pause}", *_state(works.paper(bend=True, sphere=False)))
    candidates = [
        bench.core(paused, works.Paused, by=kernel, precision="single", threads=threads)
        for kernel in bench.kernels
        for threads in (*bench.threads, None)
    ]
    run(bench, candidates)


def calls(bench: Bench) -> None:
    """What a call costs beside its step: one step a call, on the smallest cloth there is."""
    cloth = cs.Cloth((2, 2), (1 / 31, 1 / 31), mass=2.0)
    x = cloth.rest_positions
    start = Start("2 x 2", cs.Scene(cloth), x, np.zeros_like(x))
    each = Start("2 x 2, a step a call", *_state(start))
    options = {"precision": "double", "threads": 1}
    run(
        bench,
        [
            bench.core(one, make, by=kernel, **options)
            for kernel in bench.kernels
            for one, make in ((start, works.Core), (each, works.Calls))
        ],
    )


def accuracy(bench: Bench) -> dict[str, Any]:
    """Double at dt = 1e-4 s: how much faster than real time, and how far from the solution."""
    scene = cs.scenes.paper_swing(bend=True)
    x, v = scene.initial_position, scene.initial_velocity
    duration, dt = 0.25, 1e-4
    fine = bench.settings.reference_dt
    expected, _ = cs.step(
        scene, x, v, fine, round(duration / fine), kernel="gather", strict=True, threads=1
    )
    result: dict[str, Any] = {"duration": duration, "dt": dt, "reference_dt": fine}
    for kernel in bench.kernels:
        end, _ = cs.step(scene, x, v, dt, round(duration / dt), kernel=kernel, threads=1)
        result[kernel] = float(np.linalg.norm(end - expected, axis=-1).max())
    return result


ALL = {
    "steps": steps,
    "features": features,
    "batch": batch,
    "grids": grids,
    "frames": frames,
    "calls": calls,
}


def kernels() -> tuple[str, ...]:
    """The kernels that this build offers by name."""
    return tuple(k for k in plan.KERNELS if k != "auto")
