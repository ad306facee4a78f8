"""`clothsim bench`: measure speed beside the machine's limits and other codes."""

from __future__ import annotations

import argparse
from typing import Any

from clothsim.lab.bench import FULL, NORMAL, QUICK, SECTIONS, bench
from clothsim.lab.bench.bench_report import text

from ..base.plain_json import as_json
from ..base.progress import wanted_by_command
from ._common import add_command


def add_parser(subparsers: Any) -> None:
    command = add_command(subparsers, "bench", run)
    size = command.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="fewer and shorter windows: a minute or two")
    size.add_argument("--full", action="store_true", help="more windows, and 4096 x 4096 (takes 8 GB of memory)")
    command.add_argument(
        "--out",
        default="benchmarks/results",
        metavar="DIR",
        help="folder of the files (default: benchmarks/results): a CSV and plots, named after "
        "the machine, and after --quick and the sections where those are given, so that they "
        "do not replace the files of a whole run",
    )
    command.add_argument(
        "--section", choices=SECTIONS, action="append", help="only this one; may be given several times (default: all)"
    )


def run(args: argparse.Namespace) -> None:
    report = bench(
        args.out,
        settings=QUICK if args.quick else FULL if args.full else NORMAL,
        sections=args.section or SECTIONS,
        progress=wanted_by_command(),
    )
    print(as_json(report) if args.json else text(report))
    if not args.json:
        print("\nWritten: " + ", ".join(report["files"]))
