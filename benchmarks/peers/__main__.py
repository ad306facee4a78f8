"""`cs.work_precision` with other programs beside it: numba, SciPy and diffrax, where they are installed.

    python benchmarks/peers paper_swing --bend --threads 2                       # a CSV file and a picture
    python benchmarks/peers paper_swing --bend --threads 2 --errors 1e-3,1e-9    # at each error, the fastest run

docs/accuracy.md explains the figures.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

import clothsim as cs
from common import aligned

from peers.solvers import installed_peers, refused

SCENES = ("hanging", "oscillator", "paper_swing")


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/peers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", nargs="?", default="paper_swing", choices=SCENES, help="default: paper_swing")
    parser.add_argument("--bend", action="store_true", help="with bend springs (paper_swing)")
    parser.add_argument("--duration", type=float, default=0.5, metavar="S", help="seconds to simulate (default 0.5)")
    parser.add_argument("--method", action="append", metavar="NAME", help="of clothsim, only this one (default: all)")
    parser.add_argument("--precision", action="append", choices=("double", "single"), help="default: both")
    parser.add_argument("--threads", type=int, metavar="N", help="threads (default: automatic, one for the peers)")
    parser.add_argument("--windows", type=int, default=5, metavar="N", help="timed runs of each (default 5)")
    parser.add_argument("--errors", type=_numbers, metavar="E,E,...", help="rms errors [m]: print the fastest run at each")
    parser.add_argument("--out", type=Path, default=Path("work-precision"), metavar="DIR", help="folder of the files")
    args = parser.parse_args(argv)
    scene = getattr(cs.scenes, args.scene)(**({"bend": True} if args.bend else {}))
    if reason := refused(scene):
        parser.error(reason)
    peers, missing = installed_peers(scene, args.threads)
    names = args.method or [*cs.integrators(), *(f"{n} adaptive" for n, one in cs.integrators().items() if one.adaptive)]
    options = {"precisions": args.precision or ("double", "single"), "threads": args.threads, "windows": args.windows}
    options |= {"methods": [*names, *peers], "progress": sys.stderr.isatty()}
    data = cs.work_precision(scene, args.duration, **options)
    if args.errors:
        head = "rms error m", "library", "fastest", "setting", "s per s", "evaluations"
        print(aligned(head, fastest(data, args.errors)))
    else:
        args.out.mkdir(parents=True, exist_ok=True)
        start = args.out / f"{args.scene}{'_bend' if args.bend else ''}_peers"
        data.to_dataframe().dropna(subset=["setting"]).to_csv(f"{start}.csv")
        data.clothsim.plot()[0].figure.savefig(f"{start}.png")
        print(f"Written: {start}.csv, {start}.png")
    for reason in missing:
        print(f"Not measured: {reason}", file=sys.stderr)


def fastest(data: Any, errors: list[float]) -> Iterator[tuple[str, ...]]:
    """For each error the fastest run of clothsim and of the others that reaches it, one row each."""
    for error in errors:
        for own in (True, False):
            able = (data.rms_error <= error) & ((data.library == "clothsim") == own)
            if not able.any():
                continue
            one = data.isel(data.wall_time.where(able).argmin(...))
            what = str(one.library.item()), str(one.solver.item())
            yield f"{error:g}", *what, *(f"{float(one[k]):.4g}" for k in ("setting", "wall_time", "force_evaluations"))


def _numbers(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


if __name__ == "__main__":
    main()
