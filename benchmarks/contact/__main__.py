"""Measure what docs/contact.md and docs/accuracy.md claim of contact.

python benchmarks/contact                # every figure in short sizes
python benchmarks/contact cost --full    # one figure, in the sizes of the claims
python benchmarks/contact compare --full --out contact.png    # and its picture
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

from clothsim.paper.experiments import run_comparison
from common import aligned, conditions, short

import contact

_LENGTHS = (
    "points_so_far",
    "triangles_so_far",
    "error",
    "rk4_error",
    "stand_off",
    "least_gap",
    "triangle",
)
UNITS = (
    dict.fromkeys(_LENGTHS, "m")
    | {"time": "s", "energy_gained": "J", "kinetic_energy": "J"}
    | {"dissipation": "s/m", "speed": "m/s", "slip_speed": "m/s"}
)

# Figure: its function, what it shows, and its arguments in short and in full.
FIGURES: dict[str, tuple[Callable[..., Any], str, dict[str, Any], dict[str, Any]]] = {
    "cost": (
        contact.cost,
        "a step with an obstacle against one without",
        {"windows": 12},
        {"windows": 60},
    ),
    "layer": (contact.layer, "what a layer costs and gives", {"layers": 2}, {}),
    "compare": (contact.compare, "error of every response", {"scenes": 1, "steps": 4}, {}),
    "table": (run_comparison, "every response on every sphere", {"part": 0.4}, {"part": 1.0}),
}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python benchmarks/contact",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "figures", nargs="*", metavar="FIGURE", help=f"some of {', '.join(FIGURES)} (default: all)"
    )
    parser.add_argument(
        "--full", action="store_true", help="the sizes that are claimed; many minutes"
    )
    parser.add_argument("--out", type=Path, help="file of the picture of compare")
    args = parser.parse_args(argv)
    for name in args.figures:
        if name not in FIGURES:
            parser.error(f"FIGURE must be some of {', '.join(FIGURES)}, got {name!r}")
    for name in args.figures or FIGURES:
        function, title, short_sizes, sizes = FIGURES[name]
        result = function(**(sizes if args.full else short_sizes))
        print(f"{name}: {title}\n{_text(result)}", flush=True)
        if name == "compare" and args.out:
            contact.draw(result, args.out)
    print(conditions())


def _text(result: list[dict[str, Any]]) -> str:
    titles = [
        key.replace("_", " ") + (f" [{UNITS[key]}]" if key in UNITS else "") for key in result[0]
    ]
    cells = [[short(row.get(key)) for key in result[0]] for row in result]
    return aligned(titles, cells, left=range(len(titles)), indent="  ", rule=False)


if __name__ == "__main__":
    main()
