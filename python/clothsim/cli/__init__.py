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

from ..base.progress import print_above
from .commands import COMMANDS

IN_PYTHON = {
    "sweep": 'cs.sweep(scene, {"stiffness": [1e3, 1e4]}, duration=1.0, store="s.zarr")',
    "work-precision": "cs.work_precision(scene, 0.5).clothsim.plot()",
    "stability": "cs.stability_map(scene, stiffness, dt).clothsim.plot()",
    "plot": 'cs.load_run("run.npz").plot("run.png")',
    "export": 'cs.load_run("run.npz").export("run.usdc")',
    "scene": "cs.save_scene(scene, path), or clothsim run SCENE --save-scene FILE",
    "view": "cs.view(scene)",
}
"""What an earlier version had as commands (docs/runs.md)."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser of the whole command line, with the arguments of the chosen command."""
    top = _Parser(prog="clothsim", description="Mass-spring cloth meeting spheres.")
    top.add_argument("--version", action="version", version=f"clothsim {cs.__version__}")
    subparsers = top.add_subparsers(metavar="COMMAND", required=True)
    for name, (text, add_arguments, run) in COMMANDS.items():
        command = subparsers.add_parser(name, help=text, description=text, allow_abbrev=False)
        if name == chosen:
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
    given = sys.argv[1:] if argv is None else list(argv)
    chosen = next((one for one in given if not one.startswith("-")), None)
    parser = _parser(chosen)
    if chosen in IN_PYTHON:
        parser.error(f"there is no command {chosen}; in Python: {IN_PYTHON[chosen]}")
    args = parser.parse_args(given)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say(args, f"warning: {message}")
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    code, said = 0, ""
    try:
        args.run(args)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader left, as in `clothsim info | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ValueError, TypeError) as error:
        code, said = 2, str(error)
    except (ArithmeticError, ImportError, MemoryError, OSError, RuntimeError) as error:
        code, said = 1, str(error)
    except KeyboardInterrupt as stop:
        code, said = 130, "; ".join(filter(None, ("interrupted", str(stop))))
    if code:
        _say(args, f"error: {said}")
    return code


def _say(args: argparse.Namespace, message: str) -> None:
    print_above(f"clothsim {args.command}: {' '.join(message.split())}", sys.stderr)
