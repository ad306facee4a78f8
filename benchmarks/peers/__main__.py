"""`cs.work_precision` with other programs beside it: numba, SciPy and diffrax, where they are
installed.

    # three scenes, the fastest at each error
    python benchmarks/peers --threads 2
    # one scene, these errors
    python benchmarks/peers paper_swing --bend --threads 2 --errors 1e-3,1e-9
    # the call `cs.simulate(scene, duration, rtol=...)`, and a figure of speed against error
    python benchmarks/peers paper_swing --bend --threads 2 --method simulate --out speed.png

docs/accuracy.md explains the figures. A peer that its experts would write faster: please send us
the code, in benchmarks/peers/solvers.py, as an issue or a pull request.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

import clothsim as cs
import numpy as np
from common import aligned, conditions

from peers.solvers import default_call, installed_peers

SCENES = {
    "oscillator": cs.scenes.oscillator,
    "paper_swing": cs.scenes.paper_swing,
    "paper_swing_bend": lambda: cs.scenes.paper_swing(bend=True),
}
PACKAGES = ("numba", "scipy", "diffrax", "jax")
FRAMES = 5  # of the reference, at which errors are taken
HEAD = (
    "rms error m",
    "library",
    "fastest",
    "setting",
    "s per s",
    "spread",
    "error m",
    "over frames m",
    "evaluations",
    "ratio",
)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/peers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "scenes",
        nargs="*",
        choices=[[], *SCENES],
        metavar="SCENE",
        help=f"default: {', '.join(SCENES)}",
    )
    parser.add_argument("--bend", action="store_true", help="paper_swing with bend springs")
    parser.add_argument(
        "--duration", type=float, default=0.5, metavar="S", help="seconds to simulate (default 0.5)"
    )
    parser.add_argument(
        "--method",
        action="append",
        metavar="NAME",
        help='of clothsim, only this one; "simulate" is the default call with its estimate '
        "(default: all, without that call)",
    )
    parser.add_argument(
        "--precision", action="append", choices=("double", "single"), help="default: both"
    )
    parser.add_argument(
        "--threads", type=int, metavar="N", help="threads (default: automatic, one for the peers)"
    )
    parser.add_argument(
        "--windows", type=int, default=5, metavar="N", help="timed runs of each (default 5)"
    )
    errors = {"type": _numbers, "default": [1e-3, 1e-6, 1e-9, 1e-12], "metavar": "E,E,..."}
    parser.add_argument("--errors", **errors, help="rms errors [m] (default 1e-3,1e-6,1e-9,1e-12)")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="also draw speed against error, a panel for each scene",
    )
    parser.add_argument(
        "--csv",
        type=Path,
        metavar="FILE",
        help="also write every run to a CSV file, one for each scene",
    )
    args = parser.parse_args(argv)
    datasets = {}
    bend = "_bend" if args.bend else ""
    for name in [f"{name}{bend * (name == 'paper_swing')}" for name in args.scenes] or SCENES:
        datasets[name], missing = measure(
            name,
            args.duration,
            args.method,
            threads=args.threads,
            windows=args.windows,
            precisions=args.precision or ("double", "single"),
        )
        data = datasets[name]
        print(
            f"{name}, {args.duration:g} "
            f"s\n{aligned(HEAD, fastest(data, args.errors), left=(0, 1, 2))}"
        )
        print(f"{conditions(PACKAGES)}\n", flush=True)
        if args.csv:
            table = data.to_dataframe().dropna(subset=["setting"])
            table.to_csv(
                args.csv if len(args.scenes) == 1 else args.csv.with_stem(f"{args.csv.stem}_{name}")
            )
    if args.out:
        draw(datasets, args.out)
    for reason in missing:
        print(f"Not measured: {reason}", file=sys.stderr)


def measure(
    name: str,
    duration: float,
    methods: Iterable[str] | None,
    threads: int | None,
    windows: int,
    precisions: Sequence[str] = ("double", "single"),
) -> tuple[Any, list[str]]:
    """Return runs of clothsim's methods (None: all) and of the peers, and the peers' absences.

    The runs are a dataset of `cs.work_precision`; an absence is a reason why a peer was not
    measured.
    """
    scene = SCENES[name]()
    peers, absences = installed_peers(scene, threads)
    if methods is None:
        adaptive = [
            f"{name} adaptive" for name, facts in cs.integrators().items() if facts.adaptive
        ]
        methods = [*cs.integrators(), *adaptive]
    calls = [default_call(threads) if name == "simulate" else name for name in methods]
    data = cs.work_precision(
        scene,
        duration,
        [*calls, *peers],
        precisions=precisions,
        threads=threads,
        windows=windows,
        reference=cs.reference(scene, duration, duration / FRAMES),
        progress=sys.stderr.isatty(),
    )
    return data, absences


def fastest(data: Any, errors: list[float]) -> Iterator[tuple[str, ...]]:
    """Yield for each error the fastest run that reaches it, clothsim's and the others'.

    The ratio is that of the others' time to clothsim's.
    """
    for error in errors:
        ours = np.nan
        for is_own in (True, False):
            able = (
                (data.rms_error <= error)
                & ((data.library == "clothsim") == is_own)
                & np.isfinite(data.wall_time)
            )
            if not able.any():
                continue
            run = data.isel(data.wall_time.where(able).argmin(...))
            time, spread = float(run.wall_time), float(run.wall_time_spread / run.wall_time)
            ours = time if is_own else ours
            errors_of_run = (f"{float(run[k]):.1e}" for k in ("rms_error", "frames_rms_error"))
            labels = (
                f"{error:g}",
                str(run.library.item()),
                str(run.solver.item()),
                f"{float(run.setting):.3g}",
            )
            ratio = "" if is_own else f"{time / ours:.1f}"
            yield (
                *labels,
                f"{time:.3g}",
                f"{spread:.0%}",
                *errors_of_run,
                f"{float(run.force_evaluations):.0f}",
                ratio,
            )


def best(data: Any) -> Any:
    """Return the front of clothsim's runs as one solver, and those of the best other solvers.

    The best other solvers have a run on the front of all others.
    """
    import xarray as xr

    is_own = (data.library == "clothsim").values
    good = front(data.isel(solver=~is_own)).any(axis=1)
    lines = []
    for m, runs in enumerate(
        [data.isel(solver=is_own), *(data.isel(solver=[k]) for k in np.flatnonzero(~is_own)[good])]
    ):
        on_front = front(runs)
        order = np.argsort(runs.wall_time.values[on_front])
        names = "wall_time", "rms_error", "force_evaluations"
        columns = {
            name: (("solver", "level"), runs[name].values[on_front][order][None]) for name in names
        }
        of_solver = {
            name: runs[name].values[0]
            for name in ("solver", "integrator", "library", "precision", "control")
        }
        of_solver |= (
            {}
            if m
            else {
                "solver": "clothsim",
                "integrator": "clothsim",
                "precision": "double",
                "control": "dt",
            }
        )
        labels = {name: ("solver", [value]) for name, value in of_solver.items()}
        lines.append(xr.Dataset(columns, {**labels, "level": np.arange(len(order))}))
    lines_of_both = xr.concat(lines, "solver", join="outer")
    return lines_of_both.assign(pareto=lines_of_both.rms_error < 0).assign_attrs(data.attrs)


def front(data: Any) -> np.ndarray:
    """Return runs that no other run of `data` beats in both time and error."""
    time = data.wall_time.values
    error = data.rms_error.values
    finite = np.isfinite(time) & np.isfinite(error)
    beaten = [
        (finite & (time <= t) & (error <= e) & ((time < t) | (error < e))).any()
        for t, e in zip(time.flat, error.flat)
    ]
    return finite & ~np.array(beaten, bool).reshape(time.shape)


def draw(datasets: dict[str, Any], path: Path) -> None:
    """Draw speed against error, legible at a width of 700 pixels."""
    from matplotlib import pyplot

    pyplot.rcParams.update({"font.size": 11})
    figure, axes = pyplot.subplots(
        len(datasets), figsize=(7, 4.4 * len(datasets)), squeeze=False, layout="constrained"
    )
    for ax, (name, data) in zip(axes.ravel(), datasets.items(), strict=True):
        best(data).clothsim.plot(ax=[ax])
        ax.set_title(
            f"{name.replace('_', ' ')}: lower left is better", loc="left", fontsize="medium"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=200)
    print(f"Written: {path}")


def _numbers(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


if __name__ == "__main__":
    main()
