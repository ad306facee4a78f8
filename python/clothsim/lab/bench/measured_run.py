"""A run of the bench, asked for its figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .figures import FEATURE, Figure, Figures, Missing

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
