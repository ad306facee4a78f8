"""The `clothsim` command.

Exit codes: 0 done, 1 the computation failed or a part is not installed, 2 wrong input, 130
interrupted. Every failure is one line on stderr.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from typing import NoReturn

import clothsim as cs

from ..base.progress import print_above_bars
from .commands import COMMANDS


class _ArgumentParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _make_parser(word: str | None) -> argparse.ArgumentParser:
    """Make the parser of the whole command line, with the arguments of the chosen command."""
    top = _ArgumentParser(prog="clothsim", description="Mass-spring cloth meeting spheres.")
    top.add_argument("--version", action="version", version=f"clothsim {cs.__version__}")
    subparsers = top.add_subparsers(metavar="COMMAND", required=True)
    for name, (text, add_arguments, run) in COMMANDS.items():
        command = subparsers.add_parser(name, help=text, description=text, allow_abbrev=False)
        if name == word:
            command.set_defaults(run=run, command=name)
            add_arguments(command)
            command.add_argument("--json", action="store_true", help="print JSON instead of text")
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, or those of the process, and return the exit code.

    The parser raises SystemExit, with code 2 for wrong options and 0 for ``--help``.

    >>> from clothsim.cli import main
    >>> main(["run", "paper_swing", "--duration", "-1"])
    2
    """
    words = sys.argv[1:] if argv is None else list(argv)
    command = next((word for word in words if not word.startswith("-")), None)
    args = _make_parser(command).parse_args(words)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _print_message(args, f"warning: {message}")
        return _run_and_get_exit_code(args)


def _run_and_get_exit_code(args: argparse.Namespace) -> int:
    code = 0
    message = ""
    try:
        args.run(args)
        sys.stdout.flush()
    except BrokenPipeError:  # The reader left, as in `clothsim info | head -1`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ValueError, TypeError) as error:
        code = 2
        message = str(error)
    except (ArithmeticError, ImportError, MemoryError, OSError, RuntimeError) as error:
        code = 1
        message = str(error)
    except KeyboardInterrupt as stop:
        code = 130
        message = f"interrupted; {stop}" if str(stop) else "interrupted"
    if code:
        _print_message(args, f"error: {message}")
    return code


def _print_message(args: argparse.Namespace, message: str) -> None:
    print_above_bars(f"clothsim {args.command}: {' '.join(message.split())}", sys.stderr)
