"""The shader's springs, written from the core's one list (cpp/model/stencil.hpp)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from .. import _core

Neighbour = tuple[int, int, str, int]
"""Rows and columns on, family, and the kind of spring, whose coefficients are equal."""


def springs(neighbours: Sequence[Neighbour] = _core.neighbours) -> str:
    """WGSL of the override constants of the families and of a mass point's spring forces.

    The forces add up in the order of `neighbours`, which is a part of the strict class.
    """
    families = dict.fromkeys(family for _, _, family, _ in neighbours)
    return "\n".join(
        [
            "// From cpp/model/stencil.hpp.",
            *(f"override {family}: bool = true;" for family in families),
            "",
            "fn spring_forces(id: vec3<u32>, x: vec3<real>, v: vec3<real>) -> vec3<real> {",
            "    let first = id.z * constants.parameter_stride + first_spring;",
            "    let columns = constants.columns;",
            "    let at = place(id);",
            "    var a = vec3<real>();",
            *_by_family(neighbours),
            "    return a;",
            "}",
        ]
    )


def _by_family(neighbours: Iterable[Neighbour]) -> list[str]:
    lines = []
    for family, group in groupby(neighbours, lambda neighbour: neighbour[2]):
        lines.append(f"    if ({family}) {{")
        lines += [f"        {_pull(row, column, kind)}" for row, column, _, kind in group]
        lines.append("    }")
    return lines


def _pull(row: int, column: int, kind: int) -> str:
    inside = [*_inside("id.y", row, "constants.rows"), *_inside("id.x", column, "columns")]
    place = f"at{_offset(row, 'columns')}{_offset(column)}"
    return f"if ({' && '.join(inside)}) {{ a = pulled(a, x, v, {place}, first + {3 * kind}u); }}"


def _inside(coordinate: str, way: int, end: str) -> list[str]:
    """Whether the neighbour is in the cloth, along one axis."""
    if way > 0:
        return [f"{coordinate} + {way}u < {end}"]
    return [f"{coordinate} >= {-way}u"] if way else []


def _offset(way: int, stride: str = "") -> str:
    if not way:
        return ""
    size = stride if stride and abs(way) == 1 else f"{abs(way)}u{f' * {stride}' if stride else ''}"
    return f" {'+' if way > 0 else '-'} {size}"
