"""Tables of text."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def aligned(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart; those of `left` are aligned left.

    >>> print(aligned([("family", "springs"), ("shear", "1,922"), ("bend", "16")]))
    family  springs
    shear     1,922
    bend         16
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{cell:{'<' if k in left else '>'}{widths[k]}}" for k, cell in enumerate(row)).rstrip() for row in rows
    )
