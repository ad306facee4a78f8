"""Measure what docs/contact.md and docs/contact-figures.md claim of contact.

python benchmarks/contact                # every figure in short sizes
python benchmarks/contact cost --full    # one figure, in the sizes of the claims
python benchmarks/contact compare --full --out contact.png    # and its picture
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).parents[1]))

from clothsim.paper.experiments import comparison
from clothsim.typing import Offset
from common import aligned, conditions, short

import contact

SLOPE = math.tan(0.35)

_LENGTHS = (
    "points_so_far",
    "triangles_so_far",
    "depth",
    "jitter",
    "normal_jitter",
    "slip",
    "expected",
    "spread",
    "error",
    "rk4_error",
    "stand_off",
    "least_gap",
    "triangle",
)
_ENERGIES = "made", "kinetic_at_impact", "elastic_afterwards", "energy_gained"
UNITS = (
    dict.fromkeys(_LENGTHS, "m")
    | dict.fromkeys(("dt", "time"), "s")
    | dict.fromkeys(_ENERGIES, "J")
    | {"dissipation": "s/m", "speed": "m/s", "slip_speed": "m/s"}
)

# Figure: what it shows, and its arguments in short and in full.
FIGURES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "cost": ("a step with an obstacle against one without", {"windows": 12}, {"windows": 60}),
    "layer": ("what a layer costs and gives", {"layers": 2}, {}),
    "compare": ("error of every response", {"scenes": 1, "steps": 4}, {}),
    "faces": ("deepest triangle, every step", {"every": 4}, {"every": 1}),
    "drop": ("energy made by an elastic drop", {"dt": 2e-5}, {"dt": 5e-6}),
    "under": ("energy made under the whole cloth", {}, {}),
    "resting": ("how quietly a cloth lies", {"steps": 10**5}, {"steps": 10**6}),
    "cone": ("friction below and above tan(slope)", {}, {}),
    "offsets": ('the cost of every offset of "continuous"', {"windows": 20, "scenes": 2}, {}),
    "table": ("every response on every sphere", {"part": 0.4}, {"part": 1.0}),
}


def _by_offset(
    figure: Callable[..., dict[str, Any]], other: Offset
) -> Callable[..., list[dict[str, Any]]]:
    """The figure for points with another offset, and for "cell"."""
    offsets: tuple[Offset, ...] = (other, "cell")
    return lambda **sizes: [
        {"offset": offset, **figure(**sizes, offset=offset)} for offset in offsets
    ]


def _functions() -> dict[str, Callable[..., Any]]:
    return {
        "faces": lambda every: comparison(
            responses=("method 1, corrected", "method 2, corrected", "continuous, cell"),
            every=every,
        ),
        "drop": _by_offset(contact.drop, "edge"),
        "under": _by_offset(contact.under_whole_cloth, "none"),
        "resting": _by_offset(contact.resting, "none"),
        "cone": lambda: [
            {"offset": offset, **contact.cone(part * SLOPE, offset=offset)}
            for offset in ("none", "cell")
            for part in (0.0, 0.97, 1.03)
        ],
        "cost": contact.cost,
        "layer": contact.layer,
        "compare": contact.compare,
        "offsets": contact.offsets,
        "table": comparison,
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
    functions = _functions()
    for name in args.figures or FIGURES:
        title, *sizes = FIGURES[name]
        result = functions[name](**sizes[args.full])
        print(f"{name}: {title}\n{_text(result)}", flush=True)
        if name == "compare" and args.out:
            contact.draw(result, args.out)
    print(conditions())


def _text(result: Any) -> str:
    if isinstance(result, dict):
        lines = [
            (key.replace("_", " "), short(value, UNITS.get(key, "")))
            for key, value in result.items()
        ]
        return aligned((), lines, left=(0, 1), indent="  ")
    titles = [
        key.replace("_", " ") + (f" [{UNITS[key]}]" if key in UNITS else "") for key in result[0]
    ]
    cells = [[short(row.get(key)) for key in result[0]] for row in result]
    return aligned(titles, cells, left=range(len(titles)), indent="  ", rule=False)


if __name__ == "__main__":
    main()
