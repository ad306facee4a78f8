"""Tables of text, and mappings that print as such."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

Value = TypeVar("Value")


class ReadOnly(Mapping[str, Value]):
    """A mapping that cannot be changed; its subclasses print as tables."""

    def __init__(self, entries: Mapping[str, Value]) -> None:
        self._entries = entries

    def __getitem__(self, key: str) -> Value:
        return self._entries[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def aligned(
    header: Sequence[str],
    lines: Iterable[Sequence[str]],
    left: Collection[int] = (0,),
    *,
    rule: bool = False,
    stacked: bool = False,
) -> str:
    """Align a table: columns are as wide as their widest cell and two blanks apart; those of `left` are aligned left.

    An empty `header` gives no headings. `rule` puts dashes below them, and they have a line per word if they are `stacked`.

    >>> print(aligned(("family", "mass points"), [("shear", "1,024"), ("bend", "16")], rule=True, stacked=True))
              mass
    family  points
    ------  ------
    shear    1,024
    bend        16
    """
    words = [heading.split(" ") if stacked else [heading] for heading in header]
    height = max(map(len, words), default=0)
    head = list(zip(*([""] * (height - len(column)) + column for column in words), strict=True))
    table = [*head, *lines]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    if rule:
        table.insert(len(head), ["-" * width for width in widths])
    return "\n".join(
        "  ".join(f"{cell:{'<' if k in left else '>'}{widths[k]}}" for k, cell in enumerate(row)).rstrip() for row in table
    )
