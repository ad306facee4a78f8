"""Sections of the bench: each function times one group of works and adds its figures."""

from __future__ import annotations

import gc
from functools import partial
from typing import Any, get_args

import clothsim as cs
import numpy as np
from clothsim.scenes import PAPER_DT
from clothsim.typing import Kernel
from peers.numpy_peer import NumpyPeer

from . import works
from .candidates import DTYPES, Bench, numba, run
from .figures import A_STEP_A_CALL, CONTINUOUS, CS_STEP, FEATURE
from .settings import BATCH_LONGER, BATCH_OF_FEW, IN_TURN
from .works import Start

PRECISIONS = ("single", "double")
_GRID_ERROR_STEPS = 20
_LARGEST_WITH_ERROR = 256  # rows of a grid, which the reference steps too


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
        candidates.append(bench.peer(start, partial(works.Reference, start), by="reference", precision="double", threads=1))
        for precision in PRECISIONS:
            make = partial(NumpyPeer, start.one, start.x, start.v, PAPER_DT, DTYPES[precision])
            candidates.append(bench.peer(start, make, by="numpy", precision=precision, threads=1))
            for threads in bench.threads:
                candidates += numba(bench, start, "numba gather", precision, threads)
    start = works.paper(True, False)
    candidates += [bench.core(start, by="gather", precision=precision, threads=1, strict=True) for precision in PRECISIONS]
    for precision in PRECISIONS:
        for threads in bench.threads if bench.settings.numba_parallel else (1,):
            candidates += numba(bench, start, "numba strided", precision, threads)
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
        "point damping": cloth.replace(damping=0.0, drag=0.5),
        "structural only": cloth.replace(springs=("structural",)),
        "structural, undamped": cloth.replace(springs=("structural",), damping=0.0),
        "mass per point": cloth.replace(mass=rng.uniform(0.4, 0.6, cloth.shape)),
    }
    starts = [_like(base, name, cloth=changed) for name, changed in cloths.items()]
    for count, name in ((1, "1 sphere, far"), (4, "4 spheres, far")):
        far = tuple(sphere.replace(center=(0.5, -9.0 - i, 0.5)) for i in range(count))
        starts.append(_like(base, name, spheres=far))
    for name, options in CONTINUOUS.items():
        one = sphere.replace(center=(0.5, -9.0, 0.5), response="continuous", **options)
        starts.append(_like(base, f"{name} sphere, far", spheres=(one,)))
    starts.append(Start(f"{FEATURE}on a sphere", *_state(works.contact(True))))
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
    return Start(f"{FEATURE}{name}", scene, base.x, base.v, base.t)


def batch(bench: Bench) -> None:
    """Cloths in one call, long enough that each is stepped several times while in cache.

    Each thread steps one member after the other. All threads share a last odd member.
    """
    start, few = works.batch(), works.batch(BATCH_OF_FEW)
    candidates = [
        bench.core(one, by=kernel, precision=precision, threads=threads)
        for one in (start, few)
        for kernel in bench.kernels
        for precision in PRECISIONS
        for threads in bench.threads
    ]
    if bench.settings.numba_parallel:
        for precision in PRECISIONS:
            for threads in bench.threads:
                candidates += numba(bench, start, "numba strided", precision, threads)
    run(bench, candidates, longer=BATCH_LONGER)


def grids(bench: Bench) -> None:
    """Square grids of growing size, one after the other to keep memory small.

    The works of a grid take turns, so that a slow spell affects all of them. Large grids go one by
    one, because not all states may fit.
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
        if rows in bench.settings.numba_sizes:
            for precision in PRECISIONS:
                candidates += numba(bench, start, "numba strided", precision, bench.threads[-1])
        if rows > IN_TURN:
            for candidate in candidates:
                run(bench, [candidate], large=True)
                gc.collect()
        else:
            run(bench, candidates, _GRID_ERROR_STEPS if rows <= _LARGEST_WITH_ERROR else 0)


def frames(bench: Bench) -> None:
    """One step per frame of an 800 x 800 cloth, with and without a copy of the positions; steps after a pause."""
    grid = _state(works.grid(800))
    frame = Start("frame 800" + A_STEP_A_CALL, *grid)
    copied = Start(frame.name + ", positions copied", *grid)
    candidates = [
        bench.core(start, make, by=kernel, precision="single", threads=threads)
        for kernel in bench.kernels
        for threads in bench.threads[1:] or bench.threads
        for start, make in ((frame, works.Calls), (copied, works.Frames))
    ]
    run(bench, candidates)
    cloth = _state(works.paper(bend=True, sphere=False))
    candidates = []
    for steps, name in ((1, "first step"), (20, "20 steps")):
        paused = Start(f"32 x 32, {name} after {1e3 * works.Paused.PAUSE:.0f} ms", *cloth)
        make = partial(works.Paused, cold_steps=steps)
        candidates += [
            bench.core(paused, make, by=kernel, precision="single", threads=threads)
            for kernel in bench.kernels
            for threads in (*bench.threads, None)
        ]
    run(bench, candidates)


def calls(bench: Bench) -> None:
    """Cost of a call beside its steps, on the smallest cloth there is and on the paper's."""
    cloth = cs.Cloth((2, 2), (1 / 31, 1 / 31), mass=2.0)
    x = cloth.rest_positions
    smallest = Start("2 x 2", cs.Scene(cloth), x, np.zeros_like(x))
    paper = Start("32 x 32", *_state(works.paper(bend=True, sphere=False)))
    makers = (("", works.Core), (A_STEP_A_CALL, works.Calls), (CS_STEP, works.StepCalls))
    run(
        bench,
        [
            bench.core(Start(start.name + how, *_state(start)), make, by=kernel, precision=precision, threads=threads)
            for kernel in bench.kernels
            for start, precision, counts in ((smallest, "double", (1,)), (paper, "single", (1, 2)))
            for threads in counts
            if threads in bench.threads
            for how, make in makers
        ],
    )


def accuracy(bench: Bench) -> dict[str, Any]:
    """Double at dt = 1e-4 s: speed relative to real time, and distance from the solution."""
    scene = cs.scenes.paper_swing(bend=True)
    x, v = scene.initial_position, scene.initial_velocity
    duration, dt = 0.25, 1e-4
    fine = bench.settings.reference_dt
    expected, _ = cs.step(scene, x, v, fine, round(duration / fine), kernel="gather", strict=True, threads=1)
    result: dict[str, Any] = {"duration": duration, "dt": dt, "reference_dt": fine}
    for kernel in (kernel for kernel in kernels() if kernel in bench.kernels):
        end, _ = cs.step(scene, x, v, dt, round(duration / dt), kernel=kernel, threads=1)
        result[kernel] = float(np.linalg.norm(end - expected, axis=-1).max())
    return result


ALL = {"steps": steps, "features": features, "batch": batch, "grids": grids, "frames": frames, "calls": calls}


def kernels() -> tuple[Kernel, ...]:
    """The kernels that this build offers by name."""
    return tuple(k for k in get_args(Kernel) if k != "auto")
