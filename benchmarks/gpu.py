"""Experiment 4 of Kim et al.: CPU against GPU over cloth sizes and batches. Runs unattended.

    pip install 'clothsim[gpu,plot]'
    python benchmarks/gpu.py                    # every adapter, some hours
    python benchmarks/gpu.py --quick            # a minute
    python benchmarks/gpu.py --adapter NVIDIA --sizes 32 256 --batches 64 --precision single

Writes <name>_<adapter>.csv after every scene, so that what was measured survives an interruption. At the end writes
<name>_<adapter>.png, and prints the tables with the crossover. A target that cannot do a scene (memory, limits, an adapter
lost) is left out and named. A window of frames that takes long ends early, and the tables say after how many steps.

Columns: steps_per_second is the median of the runs, beside its quartiles. us_per_step, cloth_steps_per_second and
ns_per_point_step follow from it; the last two count the cloths or mass points of all members. times_fastest_cpu is the
speed over the fastest CPU target with equal scene and precision. memory_bytes_per_second is the bandwidth of the target's
memory, read and written; memory_bytes_per_point_step is what it moves in the time of a point-step. steps_asked and
steps_timed are in all runs; frames_per_run and shortened say whether windows ended early. first_run_setup_seconds is the
making of the first stepper.
"""

import argparse
import re
import sys
from dataclasses import replace
from pathlib import Path

from clothsim.gpu import adapters
from clothsim.paper import gpu_report as report
from clothsim.paper.gpu_runs import GPU, Settings, count, run
from common import aligned

QUICK = Settings(
    sizes=(32, 128),
    batches=(16,),
    precisions=("single",),
    runs=2,
    seconds=0.2,
    paper_seconds=0.2,
    first_frames=4,
    first_seconds=0.05,
)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Settings()
    parser.add_argument("--quick", action="store_true", help="few and short runs")
    parser.add_argument("--adapter", help="part of the name of the adapters to measure")
    parser.add_argument("--sizes", type=int, nargs="*", help=f"default {default.sizes}")
    parser.add_argument("--batches", type=int, nargs="*", help=f"default {default.batches}")
    parser.add_argument("--method", type=int, choices=(1, 2), nargs="*", help="default both")
    parser.add_argument("--precision", choices=("single", "double"), nargs="*", help="default both")
    parser.add_argument("--runs", type=int, help=f"default {default.runs}")
    parser.add_argument("--seconds", type=float, help=f"longest window, default {default.seconds} s")
    parser.add_argument(
        "--paper-seconds",
        type=float,
        help=f"longest window of the paper's one cloth of 32 x 32, default {default.paper_seconds} s",
    )
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/gpu"), metavar="DIR")
    parser.add_argument("--name", help="begin of the files' names, before the adapter; default: gpu")
    return parser.parse_args()


def settings_of(args):
    given = {
        "sizes": args.sizes,
        "batches": args.batches,
        "methods": args.method,
        "precisions": args.precision,
        "runs": args.runs,
        "seconds": args.seconds,
        "paper_seconds": args.paper_seconds,
    }
    changes = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items() if v is not None}
    return replace(QUICK if args.quick else Settings(), **changes)


def main():
    args = arguments()
    settings = settings_of(args)
    found = adapters()
    measured = [a for a in found if not args.adapter or args.adapter.lower() in a.name.lower()]
    if not measured:
        names = ", ".join(repr(a.name) for a in found) or "none on this machine"
        sys.exit(f"no graphics adapter to measure; there are: {names}")
    for adapter in measured:
        own = re.sub(r"\W+", "_", adapter.name).strip("_").lower()
        measure(settings, adapter, args.out, f"{args.name or 'gpu'}_{own}")


def shortened(measurements):
    """Which windows were ended early, in a sentence; empty if none was."""
    some = [m for m in measurements if m.shortened]
    if not some:
        return []
    limits = sorted({m.limit for m in some})
    return [
        f"* {len(some)} of {len(measurements)} measurements are means over fewer steps than asked: "
        f"their windows were ended after {' or '.join(f'{limit:g}' for limit in limits)} s. "
        f"The shortest held {min(min(m.steps) for m in some):,} of {some[0].asked:,} steps."
    ]


def text(measurements):
    """The table, the crossovers and the first frames, to read."""
    lines = [f"WARNING: {line}" for line in report.warnings(measurements)]
    head = ("scene", "us/step", "cloth-steps/s", "ns/point-step", "times CPU", "frames", "by")
    for (precision, method), group in report.by_table(measurements).items():
        cells = []
        for m in group:
            gain = report.against_cpu(m, measurements)
            numbers = [f"{value:.4g}" for value in (1e6 / m.rate, m.rate * m.members, 1e9 / (m.rate * m.points))]
            frames = f"{report.frames_per_run(m):.3g}" + "*" * m.shortened
            cells.append((report.scene_name(m), *numbers, "" if gain is None else f"{gain:.3g}", frames, m.target.name))
        lines += ["", f"{precision}, method {method}", aligned(head, cells, left=(6,), rule=False)]
    memory = {m.target.name: m.bandwidth for m in measurements}
    lines += ["", *(f"Memory of {name}: {bandwidth / 1e9:.3g} GB/s" for name, bandwidth in memory.items())]
    lines += ["", *shortened(measurements)]
    lines += ["", "Where the shader becomes faster:", *report.crossovers(measurements)]
    lines += ["", "First frames of the first run (what the paper's first measurement has in it):"]
    for m in measurements:
        if m.target.kind == GPU and m.size == min(o.size for o in measurements) and m.members == 1:
            first, last = m.first_frames[0][0], m.first_frames[0][-1]
            lines.append(
                f"{m.target.name}, {m.precision}, method {m.method}, {report.scene_name(m)}: made in "
                f"{1e3 * m.setup[0]:.4g} ms, then {1e6 * first:.4g} us a step in the first frame, "
                f"{1e6 * last:.4g} in frame {len(m.first_frames[0])}"
            )
    return "\n".join(lines)


def measure(settings, adapter, out, name):
    """Measure one adapter beside the CPU, and write its files."""
    total, done = count(settings, [adapter]), 0

    def advance(runs):
        nonlocal done
        done += runs
        print(f"\r{done} of {total} runs", end="", file=sys.stderr, flush=True)

    def finished(measurements):
        if measurements:
            out.mkdir(parents=True, exist_ok=True)
            report.write_csv(out / f"{name}.csv", report.rows(measurements))

    missing = []

    def left_out(m, why):
        what = f"{m.target.name}, {m.precision}, method {m.method}, {m.size} x {m.size}"
        missing.append(f"{what}, {m.members} cloths: {type(why).__name__}: {why}")

    measurements = run(settings, [adapter], advance=advance, finished=finished, left_out=left_out)
    print(file=sys.stderr)
    print(text(measurements))
    if missing:
        print("\nLeft out:", *missing, sep="\n  ")
    files = report.write(measurements, out, name)
    print("\nWritten: " + ", ".join(map(str, files)))


if __name__ == "__main__":
    main()
