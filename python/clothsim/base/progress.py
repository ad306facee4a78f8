"""Progress bars, shown in a terminal or a notebook, never in a pipe or a file."""

from __future__ import annotations

import sys
import warnings
from importlib.util import find_spec
from typing import Any, TextIO

from . import check
from .extras import needed


def wanted_by_command() -> bool:
    """Whether a command shows progress: on a terminal, where tqdm is installed."""
    return sys.stderr.isatty() and find_spec("tqdm") is not None


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook of Jupyter or marimo."""
    if "marimo" in sys.modules and sys.modules["marimo"].running_in_notebook():
        return True
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and "IPKernelApp" in shell.config


def print_above(text: str, file: TextIO) -> None:
    """Print a line, above the bars that are shown."""
    tqdm = getattr(sys.modules.get("tqdm"), "tqdm", None)
    (tqdm.write if tqdm else print)(text, file=file)
    file.flush()


class ProgressBar:
    """A tqdm bar as a context; nothing where it is not asked for, or goes to a pipe or a file.

    `shown` is the caller's argument `progress`: a TypeError refuses what is no bool, and an
    ImportError names the extra that brings tqdm. `options` are those of ``tqdm.tqdm``, such as
    `total`, `unit` and `desc`. `bar` is None where nothing is shown.
    """

    def __init__(self, shown: bool, **options: Any) -> None:
        self.bar: Any = None
        if check.boolean("progress", shown):
            with warnings.catch_warnings():  # a notebook without widgets gets a bar of text
                warnings.simplefilter("ignore")
                tqdm = needed("tqdm.auto", "progress=True", "demo").tqdm
            # With None, tqdm itself finds out whether stderr is a terminal.
            bar = tqdm(disable=False if in_notebook() else None, **options)
            self.bar = None if bar.disable else bar

    def advance(self, count: float = 1) -> None:
        if self.bar is not None:
            self.bar.update(count)

    def close(self) -> None:
        """Leave the bar as it is and start a new line."""
        if self.bar is not None:
            self.bar.close()

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
