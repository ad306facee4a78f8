"""Numbers and tables as text."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def format_joules(energies: Sequence[float]) -> list[str]:
    """Format energies with their unit; rounding errors of the largest print as 0."""
    rounding = 1e-15 * max(map(abs, energies))
    return [format_quantity(0.0 if abs(energy) < rounding else energy, "J") for energy in energies]


def format_count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def format_quantity(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"


def align_table(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart; those of `left`
    are aligned left.

    >>> print(align_table([("family", "springs"), ("shear", "1,922"), ("bend", "16")]))
    family  springs
    shear     1,922
    bend         16
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = ["<" if k in left else ">" for k in range(len(widths))]
    lines = []
    for row in rows:
        cells = [f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
