"""A stopwatch."""

from __future__ import annotations

from time import perf_counter


class Stopwatch:
    """A context whose attribute `seconds` is how long it took."""

    seconds: float

    def __enter__(self) -> Stopwatch:
        self._start = perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.seconds = perf_counter() - self._start
