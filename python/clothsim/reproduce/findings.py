"""Sentences about what was measured, each worked out from the numbers of the report."""

from __future__ import annotations

from .contact import NEAR
from .paper import FRAMES_PER_SECOND, VARIANTS
from .tables import number

SAME = 0.05  # rates and depths closer than this fraction are called equal
MILLIMETRE = 1e3


def of(experiment: str, entry: dict) -> list[str]:
    """The findings of experiment "1" to "4"."""
    return {"1": _static, "2": _moving, "3": _methods, "4": _speedup}[experiment](entry)


def _cells(entry, method, variant):
    return [c for c in entry["cells"] if (c["method"], c["variant"]) == (method, variant)]


def _depths(cells, part="triangles"):
    return [MILLIMETRE * cell["penetration"][part] for cell in cells]


def _listed(values) -> str:
    return " / ".join(number(value) for value in values)


def _depth_table(entry) -> list[str]:
    frames = " / ".join(map(str, entry["frames"]))
    lines = []
    for variant in VARIANTS:
        first, second = (_listed(_depths(_cells(entry, m, variant))) for m in (1, 2))
        lines.append(
            f"Deepest triangle at frames {frames}, {variant}: method 1 {first} mm, "
            f"method 2 {second} mm."
        )
    return lines


def _worst(entry, method, variant, part="triangles") -> float:
    """Deepest over the whole run [mm]."""
    cells = _cells(entry, method, variant)
    return MILLIMETRE * cells[-1]["deepest_so_far"][part] if cells else float("nan")


def _failures(entry) -> list[str]:
    return [
        f"Method {h['method']}, {h['variant']}, ended early: {h['failure']}."
        for h in entry["histories"]
        if h["failure"]
    ]
