"""The progress bar: members done, their rate, and the time left, by the cost of members."""

from __future__ import annotations

import time

from ..base.progress import ProgressBar


class Bar:
    """A tqdm bar over the cost of the members, as a member may cost a thousand times another's."""

    def __init__(self, shown: bool, members: int, done: int, total: float) -> None:
        self._members, self._done, self._unstable = members, done, 0
        self._start, self._before = time.monotonic(), done
        self._bar = ProgressBar(
            shown,
            total=total,
            bar_format="{desc}{percentage:3.0f}%|{bar}| {postfix[0]} [{elapsed}<{remaining}]",
            desc="sweep: ",
            postfix=[self._text()],
        )

    def _text(self) -> str:
        seconds = time.monotonic() - self._start
        rate = (self._done - self._before) / seconds if seconds > 0.05 else 0.0
        unstable = f", {self._unstable} unstable" if self._unstable else ""
        return f"{self._done}/{self._members} members{unstable}, {rate:.3g}/s"

    def advance(self, members: int, unstable: int, cost: float) -> None:
        self._done += members
        self._unstable += unstable
        if (bar := self._bar.bar) is not None:
            bar.postfix[0] = self._text()
            bar.update(min(cost, bar.total - bar.n))

    def close(self) -> None:
        self._bar.close()
