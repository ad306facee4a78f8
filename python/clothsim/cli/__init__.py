"""The `clothsim` command: one module per subcommand.

A subcommand is a line of `COMMANDS` and a module with two functions. ``add_parser(subparsers)`` defines the options,
and ``run(args)`` does the work. Exit codes: 0 done, 1 the computation failed or a part is not installed, 2 wrong input,
130 interrupted. Every failure is one line on stderr.
"""

from __future__ import annotations

import argparse
import difflib
import os
import sys
import warnings
from collections.abc import Sequence
from typing import NoReturn

import clothsim as cs

from ..base.on_demand import module_of
from ..base.progress import print_above
from ._common import COMMANDS, MODULES, SCRIPTS, Narrow


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser of the whole command line. Only the module of the chosen command is imported."""
    top = _Parser(prog="clothsim", description="Mass-spring cloth meeting spheres.", formatter_class=Narrow)
    top.add_argument("--version", action="version", version=f"clothsim {cs.__version__}")
    subparsers = top.add_subparsers(metavar="COMMAND", required=True)
    for name, text in COMMANDS.items():
        if name == chosen:
            module_of("clothsim.cli." + MODULES.get(name, name.replace("-", "_"))).add_parser(subparsers)
        else:
            subparsers.add_parser(name, help=text)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line with these arguments, or those of the process, and return the exit code.

    The parser raises SystemExit, with code 2 for wrong options and 0 for ``--help``.

    >>> from clothsim.cli import main
    >>> main(["run", "paper_swing", "--duration", "-1"])
    2
    """
    given = sys.argv[1:] if argv is None else list(argv)
    chosen = next((one for one in given if not one.startswith("-")), None)
    top = parser(chosen)
    if chosen in SCRIPTS:
        top.error(f"{chosen} is a script of a clone now: {SCRIPTS[chosen]}")
    args, unknown = top.parse_known_args(given)
    if unknown:
        _refuse(args.parser, unknown)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say(args, f"warning: {message}")
        return _run(args)


def _refuse(command: argparse.ArgumentParser, unknown: Sequence[str]) -> NoReturn:
    if unknown[0] in SCRIPTS:
        command.error(f"{unknown[0]} is a script of a clone now: {SCRIPTS[unknown[0]]}")
    known = [option for action in command._actions for option in action.option_strings]
    close = difflib.get_close_matches(unknown[0], known, 1) if unknown[0].startswith("-") else []
    command.error(f"unrecognized arguments: {' '.join(unknown)}{f' (did you mean {close[0]}?)' if close else ''}")


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
        return _failed(args, 1, _in_words(error))
    except KeyboardInterrupt as stop:
        return _failed(args, 130, f"interrupted; {stop}" if str(stop) else "interrupted")
    return 0


def _in_words(error: Exception) -> object:
    """An error of a file in words, others as they are."""
    if not isinstance(error, OSError) or error.filename is None:
        return error
    kinds = {FileNotFoundError: "there is no file", IsADirectoryError: "a folder is no file:"}
    kinds[PermissionError] = "you may not read or write"
    return f"{kinds.get(type(error), error.strerror)} {error.filename!r}"


def _failed(args: argparse.Namespace, code: int, error: object) -> int:
    _say(args, f"error: {error}")
    return code


def _say(args: argparse.Namespace, message: str) -> None:
    print_above(f"clothsim {args.command}: {' '.join(message.split())}", sys.stderr)
