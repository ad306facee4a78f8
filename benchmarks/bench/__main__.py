"""Measure the speed of steps, beside the machine's limits and other programs: docs/benchmarks.md.

python benchmarks/bench                    # a few minutes
python benchmarks/bench --quick            # one or two minutes, coarse figures
python benchmarks/bench --section steps    # one part
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

from common import as_json

from bench import FULL, NORMAL, QUICK, SECTIONS, bench
from bench.report import text


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="fewer and shorter windows: a minute or two")
    size.add_argument("--full", action="store_true", help="more windows, and 4096 x 4096 (takes 8 GB of memory)")
    parser.add_argument(
        "--out",
        default=Path(__file__).parents[1] / "results",
        metavar="DIR",
        help="folder of the files (default: benchmarks/results): a CSV and plots, named after the machine",
    )
    parser.add_argument(
        "--section", choices=SECTIONS, action="append", help="only this one; may be given several times (default: all)"
    )
    args = parser.parse_args(argv)
    settings = QUICK if args.quick else FULL if args.full else NORMAL
    report = bench(args.out, settings=settings, sections=args.section or SECTIONS)
    print(as_json(report) if args.json else text(report))
    if not args.json:
        print("\nWritten: " + ", ".join(report["files"]))


if __name__ == "__main__":
    main()
