"""The fastest method at each error, as text."""

from __future__ import annotations

from ..base.table import aligned
from .front import Front, statement


def text_of_front(found: Front) -> str:
    """At each error the fastest choice, the next method and the best peer."""
    header = (
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
    lines = []
    for one in statement(found):
        lines.append(
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
        )
    text = aligned(header, lines, left=(0, 1, 5, 7))
    return text + "".join(f"\nNot measured: {reason}" for reason in found.missing)


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else f"{value:{form}}{unit}"
