"""`clothsim work-precision` with other programs beside it: numba, SciPy and diffrax, where they are installed.

    python benchmarks/peers paper_swing --bend --threads 2              # a table, a CSV file, a picture
    python benchmarks/peers paper_swing --bend --threads 2 --fastest    # at each error, the fastest choice

docs/accuracy.md explains the figures.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

import clothsim as cs
from clothsim import accuracy
from common import as_json

from peers.solvers import installed_peers, refused

SCENES = ("hanging", "oscillator", "paper_swing")


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/peers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", nargs="?", default="paper_swing", choices=SCENES, help="default: paper_swing")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    parser.add_argument("--bend", action="store_true", help="with bend springs (paper_swing)")
    parser.add_argument("--duration", type=float, default=0.5, metavar="S", help="seconds to simulate (default 0.5)")
    parser.add_argument("--method", action="append", metavar="NAME", help="of clothsim, only this one (default: all)")
    parser.add_argument("--precision", action="append", choices=("double", "single"), help="default: both")
    parser.add_argument("--threads", type=int, metavar="N", help="threads (default: automatic, one for the peers)")
    parser.add_argument("--windows", type=int, default=5, metavar="N", help="timed runs of each (default 5)")
    parser.add_argument("--fastest", action="store_true", help="instead: at each error the fastest method")
    parser.add_argument("--errors", type=_numbers, metavar="E,E,...", help="rms errors [m] of --fastest")
    parser.add_argument("--out", type=Path, default=Path("work-precision"), metavar="DIR", help="folder of the files")
    args = parser.parse_args(argv)
    scene = getattr(cs.scenes, args.scene)(**({"bend": True} if args.bend else {}))
    if reason := refused(scene):
        parser.error(reason)
    peers, missing = installed_peers(scene, args.threads)
    names = args.method or [*cs.integrators(), *(f"{n} adaptive" for n, one in cs.integrators().items() if one.adaptive)]
    options = {"precisions": args.precision or ("double", "single"), "threads": args.threads, "windows": args.windows}
    options |= {"methods": [*names, *peers], "progress": sys.stderr.isatty()}
    if args.fastest:
        found = accuracy.fastest(scene, args.duration, *([args.errors] if args.errors else []), **options)
        print(as_json(found.statement()) if args.json else found)
    else:
        data = cs.work_precision(scene, args.duration, **options)
        args.out.mkdir(parents=True, exist_ok=True)
        written = accuracy.write_runs(data, args.out / f"{args.scene}{'_bend' if args.bend else ''}_peers")
        print(as_json(data.to_dict()) if args.json else accuracy.text_of_runs(data))
        print("Written: " + ", ".join(map(str, written)), file=sys.stderr)
    for reason in missing:
        print(f"Not measured: {reason}", file=sys.stderr)


def _numbers(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


if __name__ == "__main__":
    main()
