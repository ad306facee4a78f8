"""Tables of text."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def aligned(
    header: Sequence[str],
    lines: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    indent: str = "",
    *,
    rule: bool = False,
    stacked: bool = False,
) -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart.

    An empty `header` gives no headings. Columns of `left` are aligned left, others right. `indent` stands before every line.
    `rule` puts dashes below the headings, which have a line per word if they are `stacked`.
    >>> print(aligned(("family", "mass points"), [("shear", "1,024"), ("bend", "16")], rule=True, stacked=True))
              mass
    family  points
    ------  ------
    shear    1,024
    bend        16
    """
    body = list(lines)
    head = []
    if header:
        words = [heading.split(" ") if stacked else [heading] for heading in header]
        height = max(map(len, words))
        head = list(zip(*([""] * (height - len(column)) + column for column in words), strict=True))
    table = [*head, *body]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    if rule:
        table.insert(len(head), ["-" * width for width in widths])
    return "\n".join(
        indent
        + "  ".join(
            f"{cell:<{width}}" if k in left else f"{cell:>{width}}" for k, (cell, width) in enumerate(zip(row, widths))
        ).rstrip()
        for row in table
    )
