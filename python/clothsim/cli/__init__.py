"""The `clothsim` command: one module per subcommand, with ``add_arguments(parser)`` and ``run(args)``.

Exit codes: 0 done, 1 the computation failed or a part is not installed, 2 wrong input, 130 interrupted. Every failure is
one line on stderr.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import warnings
from collections.abc import Sequence
from typing import NoReturn

import clothsim as cs

from ..base.on_demand import later
from ..base.progress import print_above

COMMANDS = {
    "run": "Simulate a scene, print its report, and write files of it.",
    "live": "Write a page that simulates a scene in the browser, by WebGPU.",
    "reproduce": "Run the experiments of Kim et al. and write a report.",
    "info": "Print version, compiler, instruction sets, threads, libraries and graphics adapters.",
}
"""The help of every command; each is a module of this package."""

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


class _Narrow(argparse.HelpFormatter):
    """Help of at most 80 columns, also in a wide terminal."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(80, shutil.get_terminal_size().columns) - 2)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _parser(chosen: str | None) -> argparse.ArgumentParser:
    """The parser of the whole command line. Only the module of the chosen command is imported."""
    top = _Parser(prog="clothsim", description="Mass-spring cloth meeting spheres.", formatter_class=_Narrow)
    top.add_argument("--version", action="version", version=f"clothsim {cs.__version__}")
    subparsers = top.add_subparsers(metavar="COMMAND", required=True)
    for name, text in COMMANDS.items():
        command = subparsers.add_parser(name, help=text, description=text, formatter_class=_Narrow, allow_abbrev=False)
        if name == chosen:
            module = later(f"cli.{name}")
            command.set_defaults(run=module.run, command=name)
            module.add_arguments(command)
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
    try:
        args.run(args)
        sys.stdout.flush()
    except (ValueError, TypeError) as error:
        return _failed(args, 2, error)
    except BrokenPipeError:  # the reader left, as in `clothsim info | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ArithmeticError, ImportError, MemoryError, OSError, RuntimeError) as error:
        return _failed(args, 1, error)
    except KeyboardInterrupt as stop:
        return _failed(args, 130, f"interrupted; {stop}" if str(stop) else "interrupted")
    return 0


def _failed(args: argparse.Namespace, code: int, error: object) -> int:
    _say(args, f"error: {error}")
    return code


def _say(args: argparse.Namespace, message: str) -> None:
    print_above(f"clothsim {args.command}: {' '.join(message.split())}", sys.stderr)
