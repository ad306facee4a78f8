"""Experiment 4 of Kim et al.: CPU against GPU over cloth sizes and batches. Runs unattended.

    pip install 'clothsim[gpu,plot]'
    python benchmarks/gpu.py                    # all adapters, about an hour
    python benchmarks/gpu.py --quick            # a minute
    python benchmarks/gpu.py --adapter NVIDIA --sizes 32 256 --batches 64 --precision single

Writes <name>.csv after every scene, so that what was measured survives an interruption,
<name>_first_frames.csv and <name>.png to --out, and prints the tables with the crossover.
docs/gpu.md says what the columns are.
"""

import argparse
import re
import sys
from dataclasses import replace
from pathlib import Path

from clothsim.gpu import adapters, report
from clothsim.gpu.experiment import Settings, count, quick, run


def arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Settings()
    parser.add_argument("--quick", action="store_true", help="few and short runs")
    parser.add_argument("--adapter", help="part of the name of the adapters to measure")
    parser.add_argument("--sizes", type=int, nargs="*", help=f"default {default.sizes}")
    parser.add_argument("--batches", type=int, nargs="*", help=f"default {default.batches}")
    parser.add_argument("--method", type=int, choices=(1, 2), nargs="*", help="default both")
    parser.add_argument(
        "--precision", choices=("single", "double"), nargs="*", help="default both"
    )
    parser.add_argument("--runs", type=int, help=f"default {default.runs}")
    parser.add_argument(
        "--seconds", type=float, help=f"longest window, default {default.seconds} s"
    )
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results"), metavar="DIR")
    parser.add_argument("--name", help="of the files; default: gpu_ and the adapter")
    return parser.parse_args()


def settings_of(args):
    given = {
        "sizes": args.sizes, "batches": args.batches, "methods": args.method,
        "precisions": args.precision, "runs": args.runs, "seconds": args.seconds,
    }  # fmt: skip
    changes = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items() if v is not None}
    return replace(quick(Settings()) if args.quick else Settings(), **changes)


def main():
    args = arguments()
    settings = settings_of(args)
    found = adapters()
    measured = [a for a in found if not args.adapter or args.adapter.lower() in a.name.lower()]
    if not measured:
        names = ", ".join(repr(a.name) for a in found) or "none on this machine"
        sys.exit(f"no graphics adapter to measure; there are: {names}")
    name = args.name or "gpu_" + re.sub(r"\W+", "_", measured[0].name).strip("_").lower()
    total, done = count(settings, measured), 0

    def advance(runs):
        nonlocal done
        done += runs
        print(f"\r{done} of {total} runs", end="", file=sys.stderr, flush=True)

    def finished(measurements):
        args.out.mkdir(parents=True, exist_ok=True)
        report.write_csv(args.out / f"{name}.csv", report.rows(measurements))

    measurements = run(settings, measured, advance=advance, finished=finished)
    print(file=sys.stderr)
    print(report.text(measurements))
    files = report.write(measurements, args.out, name)
    print("\nWritten: " + ", ".join(map(str, files)))


if __name__ == "__main__":
    main()
