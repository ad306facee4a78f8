"""Make the tables of docs/accuracy.md on this machine.

python benchmarks/accuracy.py               # print all tables; an hour
python benchmarks/accuracy.py rk4 contact   # some of them
python benchmarks/accuracy.py --write       # also write them into the page, and draw its picture
python benchmarks/accuracy.py --quick       # coarse figures, which are no claims
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import clothsim as cs
import contact
from common import conditions
from peers.__main__ import PACKAGES, SCENES, fastest, measure

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "accuracy.md"
PICTURE = ROOT / "docs" / "images" / "contact.png"
# The fastest of clothsim's methods: others only lengthen the measurement.
METHODS = ("velocity_verlet", "rk4", "dop853", "dop853 adaptive")
RK4_DT = 5e-5  # s
QUARTER = 0.25  # s, between the frames of the reference

Row = tuple[str, ...]


def reference(duration: float = 0.5, every: float = QUARTER) -> Iterator[Row]:
    """Yield the head and a row for each frame of the swing's reference."""
    solution = cs.reference(cs.scenes.paper_swing(bend=True), duration, every=every)
    yield "time", "error estimate (rms)", "error bound (rms)", "error bound (max)"
    for frame, time in list(enumerate(solution.t))[1:]:
        errors = (
            solution.error_estimate["rms"][frame],
            solution.error_bound["rms"][frame],
            solution.error_bound["max"][frame],
        )
        yield f"{time:g} s", *map(metres, errors)


def rk4(duration: float = 1.0, every: float = QUARTER) -> Iterator[Row]:
    """Yield the head and the largest error of RK4 at each frame of the swing's reference."""
    solution = cs.reference(cs.scenes.paper_swing(bend=True), duration, every=every)
    stepper = cs.Stepper(solution.scene)
    yield "time", "error"
    for frame, time in list(enumerate(solution.t))[1:]:
        stepper.advance(round((time - stepper.time) / RK4_DT), RK4_DT)
        yield f"{time:g} s", metres(solution.error_of(stepper.positions, frame)["max"])


def cost(
    scenes: Iterable[str] = tuple(SCENES),
    duration: float = 0.2,
    methods: Iterable[str] = METHODS,
    windows: int = 4,
) -> Iterator[Row]:
    """Yield the head and the fastest runs at each error, clothsim's and the best other one."""
    yield (
        "scene",
        "rms error",
        "clothsim",
        "by",
        "error: end, frames",
        "best other implementation",
        "error: end, frames",
        "ratio",
    )
    for scene in scenes:
        data, _ = measure(scene, duration, methods, threads=2, windows=windows)
        for error in (1e-3, 1e-6, 1e-9, 1e-12):
            cells = [""] * 6
            for row in fastest(data, [error]):
                _, library, solver, _, time, spread, end, frames, _, ratio = row
                if library == "clothsim":
                    cells[:3] = [f"{time} ({spread})", solver, f"{end}, {frames} m"]
                else:
                    cells[3:] = [f"{time} ({spread}), {solver}", f"{end}, {frames} m", ratio]
            yield scene, f"{error:.0e} m", *cells


def contact_errors(draw: Path | None = None, **sizes: int) -> Iterator[Row]:
    """Yield the head and a row for each scene of contact; `draw` is the file of the picture."""
    runs = contact.compare(**sizes)
    if draw:
        contact.draw(runs, draw)
    # A response, whether its runs are rk4's, and their settings: a tolerance or a step [s].
    columns = {
        '"penalty", `rtol` 1e-3; 1e-5': ("penalty", False, (1e-3, 1e-5)),
        '"penalty", rk4 at 2.5e-4; 6.25e-5 s': ("penalty", True, (2.5e-4, 6.25e-5)),
        '"ray" at 3.1e-5 s': ("ray", True, (3.125e-5,)),
        '"reflect" at 3.1e-5 s': ("reflect", True, (3.125e-5,)),
    }
    yield "scene", *columns
    for scene in dict.fromkeys(run["scene"] for run in runs):
        cells = []
        for response, by_rk4, settings in columns.values():
            cell = [
                f"{run['evaluations']:,}: {metres(run['error'])}"
                for setting in settings
                for run in runs
                if (run["scene"], run["response"]) == (scene, response)
                and (run["method"] == "rk4") == by_rk4
                and run["setting"] == setting
            ]
            cells.append("; ".join(cell))
        yield scene, *cells


# Table: its function, the sizes of --quick, and the packages that its figures depend on.
TABLES: dict[str, tuple[Callable[..., Iterator[Row]], dict[str, Any], tuple[str, ...]]] = {
    "reference": (reference, {"duration": 0.02, "every": 0.01}, ()),
    "rk4": (rk4, {"duration": 0.02, "every": 0.01}, ()),
    "cost": (cost, {"scenes": ("oscillator",), "methods": ("rk4",), "windows": 1}, PACKAGES),
    "contact": (contact_errors, {"scenes": 1, "steps": 2}, ()),
}


def metres(error: float) -> str:
    """Return an error with one digit and its unit."""
    return re.sub(r"e([+-])0", r"e\1", f"{error:.0e} m")


def markdown(rows: Iterable[Row]) -> str:
    """Return a table whose first row is the head."""
    head, *body = rows
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *body))


def replace_block(page: str, name: str, text: str) -> str:
    """Return the page with another text between the comments that name the table."""
    start = f"<!-- python benchmarks/accuracy.py {name} -->\n"
    before, mark, rest = page.partition(start)
    _, end, after = rest.partition("<!-- end -->")
    if not mark or not end:
        raise ValueError(f"the page must have {start.strip()} and <!-- end --> behind it")
    return f"{before}{start}{text}\n{end}{after}"


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", choices=[[], *TABLES], metavar="TABLE")
    parser.add_argument("--write", action="store_true", help="into docs/accuracy.md")
    parser.add_argument("--quick", action="store_true", help="a smoke run in seconds")
    args = parser.parse_args(argv)
    if args.write and args.quick:
        parser.error("--write needs the sizes of the page, without --quick")
    for name in args.tables or TABLES:
        function, quick_sizes, packages = TABLES[name]
        sizes = quick_sizes if args.quick else {}
        if args.write and name == "contact":
            sizes = {"draw": PICTURE}
        text = f"{markdown(function(**sizes))}\n\n{conditions(packages)}."
        print(f"{name}\n{text}\n", flush=True)
        if args.write:
            page = PAGE.read_text(encoding="utf8")
            PAGE.write_text(replace_block(page, name, text), encoding="utf8")


if __name__ == "__main__":
    main()
