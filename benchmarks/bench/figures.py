"""Measured figures, reasons for missing figures, and what follows from them: ratios to peers, shares of the limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

from clothsim.machine import BYTES_IN_SHARED_CACHE

PAPER_WORKS = ("swing", "static", "contact")
"""How the names of works begin that step the paper's cloth, as in its experiments."""
FEATURE = "feature: "
"""How those begin that step it with one thing changed."""
CONTINUOUS = {"continuous": {}, "continuous face": {"offset": "face"}}
"""Spheres with continuous contact, of mass points and of triangles, and what makes them so."""
A_STEP_A_CALL = ", a step a call"
CS_STEP = ", cs.step"
"""How those end that step once a call: of `Stepper.advance`, of `clothsim.step`."""


class Missing(LookupError):
    """A figure that this run does not have; the message says why."""


@dataclass(frozen=True)
class Figure:
    """One measured time.

    Parameters
    ----------
    work : str
        Name of the stepped work, such as "swing+bend", "batch" or "grid 64".
    by : str
        Kernel of the core ("gather", "edge"), or "reference", "numpy", "numba gather",
        "numba strided".
    precision : str
    threads : int or None
        None leaves the number to the core.
    instruction_set : str
        Empty for other implementations than the core.
    strict : bool
        Whether the core's arithmetic is strict.
    points, springs : int
        Rows and columns of one cloth.
    minimum, median : float
        Seconds per step of one cloth.
    windows, steps : int
        Number of windows, and of steps in a window.
    error : float or None
        Largest distance of a mass point from its place in the double reference after `error_steps` equal steps [m].
    flops : int or None
        Per step as `Scene.explain` counts them; the core only.
    """

    work: str
    by: str
    precision: str
    threads: int | None
    instruction_set: str
    strict: bool
    points: int
    springs: int
    minimum: float
    median: float
    windows: int
    steps: int
    error: float | None = None
    error_steps: int | None = None
    flops: int | None = None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


class Figures:
    """All figures of a run; a lookup that fails says why (`Missing`)."""

    def __init__(self) -> None:
        self._figures: list[Figure] = []
        self._reasons: list[tuple[dict[str, Any], str]] = []

    def __iter__(self) -> Iterator[Figure]:
        return iter(self._figures)

    def add(self, figures: Iterable[Figure]) -> None:
        self._figures += figures

    def skip(self, reason: str, **labels: Any) -> None:
        """Say why figures with these labels are missing."""
        self._reasons.append((labels, reason))

    @property
    def skipped(self) -> list[dict[str, Any]]:
        return [{**labels, "reason": reason} for labels, reason in self._reasons]

    def find(self, **labels: Any) -> list[Figure]:
        """All figures with these labels."""
        return [f for f in self._figures if all(getattr(f, k) == v for k, v in labels.items())]

    def get(self, **labels: Any) -> Figure:
        """The one figure with these labels.

        Raises
        ------
        Missing
            If there is none, or more than one.
        """
        found = self.find(**labels)
        if len(found) > 1:
            raise Missing(f"{len(found)} figures have the labels {labels}")
        if found:
            return found[0]
        for skipped, reason in self._reasons:
            if all(labels.get(k, v) == v for k, v in skipped.items()):
                raise Missing(reason)
        raise Missing("not measured in this run")


def attempt(function: Callable[[], Any], otherwise: Any, skipped: list[dict[str, Any]], **labels: str) -> Any:
    """Result of `function`. If it fails, `otherwise`, and `skipped` records the reason.

    Figures take minutes to measure, so an error in a plot or a target must not lose them.
    """
    try:
        return function()
    except Exception as error:
        skipped.append({**labels, "reason": f"{type(error).__name__}: {error}"})
        return otherwise


ALL_SPRINGS = f"{FEATURE}all springs, damped"


@dataclass(frozen=True)
class Measured:
    """Figures on which targets are evaluated."""

    figures: Figures
    kernels: tuple[str, ...]
    instruction_sets: tuple[str, ...]
    threads: tuple[int, ...]
    limits: dict[str, Any]
    accuracy: dict[str, Any] | None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Rows of the grids that were measured."""
        return tuple(sorted({int(f.work[5:]) for f in self.figures if f.work[:5] == "grid " and f.work[5:].isdigit()}))

    def seconds(self, work: str, by: str, precision: str, threads: int | None = 1, **labels: Any) -> float:
        """Least time of a step [s]; errors are the errors of `figure`."""
        return self.figure(work, by, precision, threads, **labels).minimum

    def figure(self, work: str, by: str, precision: str, threads: int | None = 1, **labels: Any) -> Figure:
        """The figure with these labels; of the core on the best instruction set by default.

        Raises
        ------
        Missing
            If this run has not measured it.
        """
        if by in ("gather", "edge"):
            if by not in self.kernels:
                raise Missing("not built yet")
            labels = {"instruction_set": self.instruction_sets[0], "strict": False, **labels}
            if labels["instruction_set"] not in self.instruction_sets:
                raise Missing(f"no {labels['instruction_set']} here")
        if threads is not None and threads > max(self.threads):
            raise Missing(f"needs {threads} cores")
        return self.figures.get(work=work, by=by, precision=precision, threads=threads, **labels)


def share_of_peak(m: Measured, by: str, precision: str, work: str = "swing+bend", threads: int = 1) -> float:
    """Flops of a step, as `Scene.explain` counts them, over the flops at the peak rate in its time."""
    if not m.limits:
        raise Missing("limits not measured in this run")
    figure = m.figure(work, by, precision, threads)
    peak = m.limits["peak"][m.instruction_sets[0], precision, threads]
    assert figure.flops is not None  # counted for the kernels of the core
    return figure.flops / figure.minimum / float(peak)


PEERS = ("reference", "numpy", "numba gather", "numba strided")
RATIOS = {peer: "x_" + peer.replace(" ", "_") for peer in PEERS}
"""The name under which a figure has its ratio to each peer."""

_OTHER_FORCES = {FEATURE + name for name in ("no damping", "point damping", "mass per point")}
"""On as many springs as the peers have, which damp them and know one mass."""


def ratios(figure: Figure, figures: Iterable[Figure]) -> dict[str, float | None]:
    """Time of each peer's step over the time of a step of the core.

    Parameters
    ----------
    figure : Figure
    figures : iterable of Figure
        All figures of the run.

    Returns
    -------
    dict
        Keys are `RATIOS`. A ratio is the peer's least time over the figure's time. The peer has equal precision, mass
        points and springs, and its fastest number of threads. The reference has double only and stands beside both
        precisions. The peer steps an equal grid or batch. The paper's cloth, with or without spheres, is compared with
        `swing`. None where there is no such peer, and for figures of peers.
    """
    others = list(figures)
    found = {peer: [f.minimum for f in others if _alike(figure, f, peer)] for peer in PEERS}
    return {
        RATIOS[peer]: min(times) / figure.minimum if times and figure.by not in PEERS else None
        for peer, times in found.items()
    }


def _alike(figure: Figure, other: Figure, peer: str) -> bool:
    """Whether the figure `other` of a peer is for the same work as the core's figure `figure`."""
    if other.by != peer or (other.points, other.springs) != (figure.points, figure.springs):
        return False
    if other.precision != ("double" if peer == "reference" else figure.precision):
        return False
    if figure.work in _OTHER_FORCES:
        return False
    if figure.work.startswith((*PAPER_WORKS, FEATURE)):
        return other.work.startswith("swing")  # the peers have no collision pass
    return other.work == figure.work


STATE_TRAFFIC = 96
"""Bytes of a point-step that reads and writes the state once: six components of 8 bytes or, in
single, six of 4 and as many compensations."""

# The gather kernel sweeps the whole cloth once a stage (cpp/engines/gather_engine.cpp). Counted
# are the values of a point in each array that a stage touches (`finish_stage` in
# cpp/kernels/gather/gather_impl.hpp): once fetched, also where it is only written, since a store fetches
# its line, and once written back if it is written. Neighbours lie in rows that are still in cache.
#
#   stage   fetched                                              written back
#   first   state 6, stage a 6, first acceleration 3       15    a, first acceleration      9
#   second  a 6, state 6, b 6, acceleration sum 3          21    b, acceleration sum        9
#   third   b 6, state 6, a 6, acceleration sum 3          21    a, acceleration sum        9
#   fourth  a 6, state 6, both accelerations 6             18    state                      6
#
# That is 108 values; in single the fourth stage also fetches and writes 6 compensations.
_GATHER_TRAFFIC = {"single": 120 * 4, "double": 108 * 8}


def traffic(kernel: str, precision: str) -> int:
    """Bytes that a point-step of a cloth larger than the caches reads and writes at least."""
    return _GATHER_TRAFFIC[precision] if kernel == "gather" else STATE_TRAFFIC


def efficiency(measured: Measured) -> list[dict[str, Any]]:
    """Each kernel's time beside its limits: 32 x 32 on one thread, 1024 x 1024 on all.

    Returns
    -------
    list of dict
        "work", "kernel", "precision", "threads", "flops_per_step", "flops_per_second",
        "share_of_peak", "bytes_per_point_step"; [s] of a point-step: "seconds_per_point" measured,
        "arithmetic_seconds_per_point" and "memory_seconds_per_point" at the limits;
        "through_memory": whether those bytes go through memory, or the cloth stays in cache;
        "bound": the larger limit of those that hold.
    """
    rows = []
    for work, threads in (("swing+bend", 1), ("grid 1024", measured.threads[-1])):
        for kernel in measured.kernels:
            for precision in ("single", "double"):
                try:
                    rows.append(_row(measured, work, kernel, precision, threads))
                except Missing:
                    continue
    return rows


def _row(m: Measured, work: str, kernel: str, precision: str, threads: int) -> dict[str, Any]:
    share = share_of_peak(m, kernel, precision, work, threads)
    figure = m.figure(work, kernel, precision, threads)
    assert figure.flops is not None  # counted for the kernels of the core
    rate = figure.flops / figure.minimum
    measured = figure.minimum / figure.points
    moved = traffic(kernel, precision)
    memory = moved / m.limits["bandwidth"][threads]
    through_memory = figure.points * STATE_TRAFFIC / 2 > BYTES_IN_SHARED_CACHE
    return {
        "work": work,
        "kernel": kernel,
        "precision": precision,
        "threads": threads,
        "flops_per_step": figure.flops,
        "flops_per_second": rate,
        "share_of_peak": share,
        "bytes_per_point_step": moved,
        "seconds_per_point": measured,
        "arithmetic_seconds_per_point": measured * share,
        "memory_seconds_per_point": memory,
        "through_memory": through_memory,
        "bound": "memory" if through_memory and memory > measured * share else "arithmetic",
    }
