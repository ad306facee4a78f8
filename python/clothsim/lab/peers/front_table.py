"""The fastest method at each error, and its targets, as text."""

from __future__ import annotations

from typing import Any

from clothsim.base.table import aligned

from .front import PEER_FACTOR, TARGETS, Front, statement


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


def targets_of(found: Front) -> list[dict[str, Any]]:
    """`TARGETS` beside what `found`, made at their errors, has."""
    measured = {one["error"]: one for one in statement(found)}
    result = []
    for target in TARGETS:
        one = measured[target.error]
        reached = one["wall_time"] is not None and one["wall_time"] <= target.wall_time
        beaten = None if one["peer_ratio"] is None else one["peer_ratio"] >= PEER_FACTOR
        result.append({"target": target.wall_time, "reached": reached, "beaten": beaten, **one})
    return result


def text_of_targets(found: Front) -> str:
    """Each target, what was measured and how much slower the best peer is."""
    header = (
        "rms error [m]",
        "target s/s",
        "measured s/s",
        "reached",
        "by",
        "setting",
        "best peer",
        "s/s",
        "slower",
        f">= {PEER_FACTOR:g}x",
    )
    words = {True: "yes", False: "no", None: "-"}
    lines = [
        (
            f"{one['error']:.0e}",
            f"{one['target']:.3f}",
            _number(one["wall_time"], ".4f"),
            words[one["reached"]],
            one["fastest"] or "none",
            _number(one["setting"], ".2e"),
            one["peer"] or "none",
            _number(one["peer_wall_time"], ".4f"),
            _number(one["peer_ratio"], ".2f", "x"),
            words[one["beaten"]],
        )
        for one in targets_of(found)
    ]
    text = aligned(header, lines, left=(0, 3, 4, 6, 9))
    return text + "".join(f"\nNot measured: {reason}" for reason in found.missing)


def _number(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else f"{value:{form}}{unit}"
