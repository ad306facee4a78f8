"""Tables of text."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def aligned(header: Sequence[str], lines: Iterable[Sequence[str]], left: Collection[int] = (0,), indent: str = "") -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart. Columns in `left` are aligned left,
    others right.
    """
    table = [header, *lines] if header else list(lines)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(
        indent
        + "  ".join(
            f"{cell:<{width}}" if k in left else f"{cell:>{width}}" for k, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in table
    )
