"""At each error, which method is fastest: every method at its cheapest setting that reaches it.

The search for a setting uses its error alone, which does not depend on the load of the machine.
Only the settings found are timed, all in turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..base import check
from ..base.progress import ProgressBar
from ..base.table import aligned
from ..model.scene import Scene
from ..typing import Precision
from .measured import Bench, Measured, label
from .methods import OWN, Method, chosen_methods
from .order import solution_for
from .solution import Reference

ERRORS = tuple(10.0**-k for k in range(4, 13))
"""Errors [m] that are asked for by default."""

# A search ends when the setting is known to this factor.
_CLOSE = 1.03

# The guaranteed stable step holds in any state; a run may stand more than twice it. So every fixed-step
# method, also of another program, is tried from this many times its default coarsest step on.
_BEYOND_GUARANTEE = 2.5

# Settings that no search goes beyond, and how many times the fewest force evaluations.
_FINEST_RTOL = 1e-14
_SKIP = 8.0


def cheapest(
    error_of: Callable[[float], float], coarsest: float, finest: float, wanted: float, factor: float = 2.0
) -> float | None:
    """The largest setting found whose error is at most `wanted` [m]; None if no setting down to `finest` reaches it.

    `error_of` gives the error of a setting [m]; infinite if unstable. It is asked from the coarsest on, each smaller by
    `factor`, until it gives at most `wanted`, and then by bisection between the last two.

    >>> 0.0097 < cheapest(lambda dt: dt**4, 1.0, 1e-6, 1e-8) <= 0.01
    True
    """
    good = coarsest
    bad = None
    while error_of(good) > wanted:
        bad = good
        good /= factor
        if good < finest:
            return None
    while bad is not None and bad / good > _CLOSE:
        middle = math.sqrt(bad * good)
        if error_of(middle) > wanted:
            bad = middle
        else:
            good = middle
    return good


@dataclass(frozen=True)
class Row:
    """One method at its cheapest setting for an error."""

    error: float
    result: Measured

    @property
    def own(self) -> bool:
        return self.result.method.library == OWN


@dataclass(frozen=True)
class Front:
    """Result of `fastest`; printed, a table.

    Attributes
    ----------
    scene : Scene
    duration : float
    errors : tuple of float
        Errors asked for [m], rms, the largest first.
    rows : tuple of Row
        For each error the methods that reach it, the fastest first.
    """

    scene: Scene
    duration: float
    errors: tuple[float, ...]
    rows: tuple[Row, ...]

    def at(self, error: float, own: bool | None = None) -> list[Row]:
        """The methods that reach `error`, fastest first; only this package's, or only other programs'."""
        return [r for r in self.rows if r.error == error and (own is None or r.own == own)]

    def wall_time(self, row: Row) -> float:
        """Wall time per simulated second [s/s]."""
        return row.result.fastest / self.duration

    def statement(self) -> list[dict[str, Any]]:
        """At each error the fastest choice, how much slower the next method is, and the best of other programs, the peers.

        Returns
        -------
        list of dict
            One per error: "error", "fastest" and "next" (labels), "setting", "wall_time",
            "force_evaluations", "next_ratio" (times slower), "peer", "peer_wall_time", "peer_ratio";
            None where nothing reaches the error.
        """
        result = []
        for error in self.errors:
            own, peer = self.at(error, own=True), self.at(error, own=False)
            other = [row for row in own[1:] if row.result.method.name != own[0].result.method.name]
            first = self.wall_time(own[0]) if own else None

            def ratio(rows: list[Row], first: float | None = first) -> float | None:
                return self.wall_time(rows[0]) / first if rows and first else None

            result.append(
                {
                    "error": error,
                    "fastest": label(own[0].result.method) if own else None,
                    "setting": own[0].result.setting if own else None,
                    "wall_time": first,
                    "force_evaluations": own[0].result.force_evaluations if own else None,
                    "next": label(other[0].result.method) if other else None,
                    "next_ratio": ratio(other),
                    "peer": label(peer[0].result.method) if peer else None,
                    "peer_wall_time": self.wall_time(peer[0]) if peer else None,
                    "peer_ratio": ratio(peer),
                }
            )
        return result

    def __str__(self) -> str:
        head = (
            "rms error [m]",
            "fastest",
            "setting",
            "evaluations",
            "s/s",
            "next method",
            "slower",
            "best peer",
            "s/s",
            "slower",
        )
        lines = [
            (
                f"{one['error']:.0e}",
                one["fastest"] or "none",
                _number(one["setting"], ".2e"),
                _number(one["force_evaluations"], "d"),
                _number(one["wall_time"], ".4f"),
                one["next"] or "none",
                _number(one["next_ratio"], ".2f", "x"),
                one["peer"] or "none",
                _number(one["peer_wall_time"], ".4f"),
                _number(one["peer_ratio"], ".2f", "x"),
            )
            for one in self.statement()
        ]
        return aligned(head, lines, left=(0, 1, 5, 7))


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else f"{value:{form}}{unit}"


def fastest(
    scene: Scene,
    duration: float,
    errors: Sequence[float] = ERRORS,
    *,
    methods: Sequence[str | Method] | None = None,
    precisions: Sequence[Precision] = ("double", "single"),
    threads: int | None = None,
    windows: int = 7,
    longest: float = 5.0,
    reference: Reference | None = None,
    progress: bool = False,
) -> Front:
    """At each error, every method at its cheapest setting that reaches it, timed in turns.

    Parameters
    ----------
    scene, duration, methods, precisions, threads, windows, reference, progress
        As for `work_precision`.
    errors : sequence of float
        Rms errors [m].
    longest : float, default 5.0
        The search ends at settings at which a run takes longer [s]. It also ends at eight times the
        force evaluations of a known run that reaches the error.

    Returns
    -------
    Front

    Examples
    --------
    >>> import clothsim as cs
    >>> from clothsim.accuracy import fastest
    >>> found = fastest(cs.scenes.oscillator(), 1.0, [1e-4, 1e-8], methods=["rk4", "dop853"],
    ...                 precisions=["double"], windows=1)
    >>> [row.result.rms <= row.error for row in found.rows]
    [True, True, True, True]
    """
    duration = check.number("duration", duration, minimum=0, exclusive=True)
    count = check.size("errors", errors)
    wanted = [check.number(f"errors[{k}]", errors[k], minimum=0, exclusive=True) for k in range(count)]
    wanted = sorted(set(wanted), reverse=True)
    chosen = chosen_methods(scene, methods, precisions, threads)
    # Methods with error control need few evaluations at every error, so they bound the search of the others.
    chosen.sort(key=lambda method: method.control != "rtol")
    rows: list[Row] = []
    best: dict[float, float] = {}
    with ProgressBar(progress, total=len(chosen), unit="method") as bar:
        bar.say("reference")
        bench = Bench(scene, solution_for(scene, duration, reference))
        bar.say("search")
        for method in chosen:
            rows += _search(bench, method, wanted, longest, best)
            bar.advance(1)
    with ProgressBar(progress, total=len(rows) * windows, unit="run", desc="timing") as bar:
        for _ in bench.time([row.result for row in rows], windows):
            bar.advance(1)
    rows.sort(key=lambda row: (-row.error, row.result.fastest))
    return Front(scene, duration, tuple(wanted), tuple(rows))


def _search(bench: Bench, method: Method, errors: list[float], longest: float, best: dict[float, float]) -> list[Row]:
    """The method at its cheapest setting for each error; `best` keeps the fewest evaluations."""
    seen: dict[float, Measured] = {}
    most = math.inf

    def error_of(setting: float) -> float:
        if setting not in seen:
            coarser = [one for one in seen.values() if one.setting > setting and one.stable]
            last = min(coarser, key=lambda one: one.setting, default=None)
            if last is not None:
                # The outcome of a smaller step is known before the step is made.
                more = last.setting / setting if method.control == "dt" else 1.0
                if more * last.once > longest or more * last.force_evaluations > most:
                    return math.inf
            seen[setting] = bench.first(method, setting)
        return seen[setting].rms

    rows = []
    coarsest = method.settings(bench.scene, bench.duration)[0]
    finest = _FINEST_RTOL if method.control == "rtol" else coarsest / 2**20
    if method.control == "dt":
        coarsest *= _BEYOND_GUARANTEE
    for error in errors:
        most = _SKIP * best.get(error, math.inf)
        # A tolerance may span ten decades; a step no more than one or two.
        factor = 10.0 if method.control == "rtol" else 2.0
        setting = cheapest(error_of, coarsest, finest, error, factor)
        if setting is None:
            continue
        coarsest = setting  # a smaller error needs no larger one
        found = seen[setting]
        best[error] = min(best.get(error, math.inf), found.force_evaluations)
        copy = Measured(method, setting, found.rms, found.max, found.force_evaluations)
        rows.append(Row(error, copy))
    return rows
