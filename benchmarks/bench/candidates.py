"""Works that are timed in turns, and their figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import clothsim as cs
import numpy as np
from clothsim.scenes import PAPER_DT
from peers import numba_peer
from peers.numba_peer import most_threads
from timing import Work, measure

from . import works
from .figures import Figure, Figures
from .settings import Settings
from .works import Start

DTYPES = {"single": np.float32, "double": np.float64}


@dataclass(frozen=True)
class Bench:
    """Parts of a run: its size, the machine's choices, and where figures go."""

    settings: Settings
    figures: Figures
    kernels: tuple[str, ...]
    instruction_sets: tuple[str, ...]
    threads: tuple[int, ...]
    numba_threads: int
    advance: Callable[[int], object]

    @property
    def best(self) -> str:
        return self.instruction_sets[0]

    def core(self, start: Start, make: Callable[..., Any] = works.Core, **options: Any) -> Candidate:
        options = {"strict": False, "instruction_set": self.best, **options}
        return Candidate(start, partial(make, start, **options), options)

    def peer(self, start: Start, make: Callable[[], Any], **labels: Any) -> Candidate:
        return Candidate(start, make, {"instruction_set": "", "strict": False, **labels}, peer=True)


@dataclass(frozen=True)
class Candidate:
    """A work still to be made, and its labels. `peer` marks a work of another implementation."""

    start: Start
    make: Callable[[], Any]
    labels: dict[str, Any]
    peer: bool = False


def run(bench: Bench, candidates: Sequence[Candidate], error_steps: int = 0, large: bool = False, longer: int = 1) -> None:
    """Time the candidates in turn and add their figures, with their errors if asked for.

    Windows are `longer` times as long as usual, and their number is smaller by this factor. A peer that does not run
    here is left out.
    """
    candidates, made = _that_run(bench, candidates)
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


def _that_run(bench: Bench, candidates: Sequence[Candidate]) -> tuple[list[Candidate], list[Any]]:
    """The candidates without peers that fail in their first step, and their works."""
    kept, made = [], []
    for candidate in candidates:
        try:
            work = candidate.make()
            if candidate.peer:
                work.run(1)  # which compiles it
        except Exception as error:
            if not candidate.peer:
                raise
            told = str(error).strip().splitlines()  # numba's errors go on for pages
            reason = f"{type(error).__name__}: {told[0] if told else 'no message'}"
            bench.figures.skip(reason, work=candidate.start.name, **candidate.labels)
            continue
        kept.append(candidate)
        made.append(work)
    return kept, made


def _errors(candidates: Sequence[Candidate], steps: int) -> list[float | None]:
    """Largest distance to the double reference after `steps` steps from the start, for each."""
    expected: dict[str, np.ndarray] = {}
    errors: list[float | None] = []
    for candidate in candidates:
        start = candidate.start
        if start.name not in expected:
            expected[start.name], _ = cs.reference_step(start.one, start.x, start.v, PAPER_DT, steps, start.t)
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


def numba(bench: Bench, start: Start, kind: str, precision: str, threads: int) -> list[Candidate]:
    """A kernel for numba as the only candidate, or none where numba may not use the threads."""
    if threads > bench.numba_threads:
        return []
    work: Callable[..., Work] = numba_peer.NumbaGather if kind == "numba gather" else numba_peer.NumbaStrided
    make = partial(work, start.scene, start.x, start.v, PAPER_DT, DTYPES[precision], threads)
    return [bench.peer(start, make, by=kind, precision=precision, threads=threads)]


def numba_threads(settings: Settings, counts: Sequence[int], figures: Figures) -> int:
    """The most threads that numba may use, 0 without numba; `figures` records what is left out."""
    kinds = ("numba gather", "numba strided")
    try:
        most = most_threads()
    except ImportError as error:
        for kind in kinds:
            figures.skip(str(error), by=kind)
        return 0
    for count in counts:
        if count > most:
            for kind in kinds:
                figures.skip(f"NUMBA_NUM_THREADS is {most}", by=kind, threads=count)
        elif count > 1 and not settings.numba_parallel:
            figures.skip("on one thread only with these settings", by=kinds[1], threads=count)
    return most
