"""`clothsim reproduce`: run the experiments of Kim et al. and write the report folder."""

from __future__ import annotations

import argparse

from clothsim.paper import EXPERIMENTS, reproduce, text

from ..base.files import as_json
from ..base.progress import wanted_by_command


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--quick", action="store_true", help="fewer and coarser steps: some 20 seconds on two free cores")
    command.add_argument("--out", default="report", metavar="DIR", help="folder of the report (default: report)")
    command.add_argument("--threads", type=int, metavar="N", help="threads (default: all)")
    command.add_argument(
        "--experiment",
        type=int,
        choices=EXPERIMENTS,
        action="append",
        help="only this one; may be given several times (default: all)",
    )


def run(args: argparse.Namespace) -> None:
    chosen = args.experiment or EXPERIMENTS
    report = reproduce(args.out, quick=args.quick, experiments=chosen, threads=args.threads, progress=wanted_by_command())
    print(as_json(report) if args.json else text(report))
    if not args.json:
        print(f"Report folder: {report['folder']} (open index.html)")
