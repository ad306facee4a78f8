"""Numbers and tables as text."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def joules(energies: Sequence[float]) -> list[str]:
    """Energies with their unit; rounding errors of the largest one print as 0."""
    rounding = 1e-15 * max(map(abs, energies))
    return [quantity(0.0 if abs(one) < rounding else one, "J") for one in energies]


def counted(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def quantity(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"


def aligned(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart; those of `left`
    are aligned left.

    >>> print(aligned([("family", "springs"), ("shear", "1,922"), ("bend", "16")]))
    family  springs
    shear     1,922
    bend         16
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            f"{cell:{'<' if k in left else '>'}{widths[k]}}" for k, cell in enumerate(row)
        ).rstrip()
        for row in rows
    )
