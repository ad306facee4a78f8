"""The `clothsim` command: one module per subcommand.

A subcommand is a module with ``add_parser(subparsers)``, which sets its function ``run(args)`` as
the parser's default. Exit codes: 0 done, 1 the computation failed or a part is not installed, 2
wrong input, 130 interrupted. Every failure is one line on stderr.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from typing import NoReturn

import clothsim as cs

from . import bench, contact, export, info, plot, reproduce, run, stability, sweep, view, work_precision

SUBCOMMANDS = (info, run, view, export, sweep, plot, stability, work_precision, contact, reproduce, bench)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    top = _Parser(prog="clothsim", description="Mass-spring cloth meeting spheres.")
    top.add_argument("--version", action="version", version=f"clothsim {cs.__version__}")
    subparsers = top.add_subparsers(metavar="COMMAND", required=True)
    for module in SUBCOMMANDS:
        module.add_parser(subparsers)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name. Default: those of the process.

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    SystemExit
        From the parser: with code 2 for wrong options, with 0 for ``--help``.

    Examples
    --------
    >>> from clothsim.cli import main
    >>> main(["run", "paper_swing", "--duration", "-1"])
    2
    """
    args = parser().parse_args(argv)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say(args, f"warning: {message}")
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    try:
        args.run(args)
        sys.stdout.flush()
    except (ValueError, TypeError) as error:
        return _failed(args, 2, error)
    except (ArithmeticError, ImportError, MemoryError, OSError, RuntimeError) as error:
        if isinstance(error, BrokenPipeError):  # the reader left, as in `clothsim info | head -1`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        return _failed(args, 1, error)
    except KeyboardInterrupt:
        return _failed(args, 130, "interrupted")
    return 0


def _failed(args: argparse.Namespace, code: int, error: object) -> int:
    _say(args, f"error: {error}")
    return code


def _say(args: argparse.Namespace, message: str) -> None:
    print(f"clothsim {args.command}: {' '.join(message.split())}", file=sys.stderr)
