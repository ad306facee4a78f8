"""Measured figures, and reasons for missing figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

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
