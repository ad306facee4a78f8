"""Progress bars, shown in a terminal or a notebook, never in a pipe or a file."""

from __future__ import annotations

import sys
import warnings
from importlib.util import find_spec
from typing import Any, TextIO

from . import check
from .extras import import_from_extra


def is_wanted_by_command() -> bool:
    """Tell whether a command shows progress: on a terminal, where tqdm is installed."""
    return sys.stderr.isatty() and find_spec("tqdm") is not None


def is_in_notebook() -> bool:
    """Tell whether this process is the kernel of a notebook of Jupyter or marimo."""
    if "marimo" in sys.modules and sys.modules["marimo"].running_in_notebook():
        return True
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and "IPKernelApp" in shell.config


def print_above_bars(text: str, file: TextIO) -> None:
    """Print a line, above the bars that are shown."""
    tqdm = getattr(sys.modules.get("tqdm"), "tqdm", None)
    (tqdm.write if tqdm else print)(text, file=file)
    file.flush()


_OF_TIME = "{l_bar}{bar}| {n:.4g}/{total:.4g} s of simulated time [{elapsed}<{remaining}]"


class ProgressBar:
    """A tqdm bar as a context; nothing where it is not asked for, or goes to a pipe or a file.

    `progress` is the argument of the caller: a TypeError refuses what is no bool, and an
    ImportError names the extra that brings tqdm. `options` are those of ``tqdm.tqdm``, such as
    `total`, `unit` and `desc`. `bar` is None where nothing is shown.
    """

    def __init__(self, progress: bool, **options: Any) -> None:
        self.bar: Any = None
        if check.boolean("progress", progress):
            with warnings.catch_warnings():  # A notebook without widgets gets a bar of text.
                warnings.simplefilter("ignore")
                tqdm = import_from_extra("tqdm.auto", "progress=True", "demo").tqdm
            if is_in_notebook():  # A notebook shows stderr as an error, in red.
                options = {"file": sys.stdout, "disable": False, **options}
            else:  # With None, tqdm itself finds out whether stderr is a terminal.
                options = {"disable": None, **options}
            bar = tqdm(**options)
            self.bar = None if bar.disable else bar

    @classmethod
    def for_simulated_time(
        cls, progress: bool, total: float, desc: str | None = None
    ) -> ProgressBar:
        """Make a bar that counts seconds of simulated time."""
        return cls(progress, total=total, desc=desc, bar_format=_OF_TIME)

    def advance(self, count: float = 1) -> None:
        """Count what has been done since the last call."""
        if self.bar is not None:
            self.bar.update(count)

    def expect_more(self, more: float) -> None:
        """Add to the total."""
        if self.bar is not None:
            self.bar.total += more
            self.bar.refresh()

    def close(self) -> None:
        """Leave the bar as it is and start a new line."""
        if self.bar is not None:
            self.bar.close()

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
