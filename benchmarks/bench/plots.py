"""Plots: time against grid size with the machine's limits, threads, and the price of features."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from common import BLUE, GREEN, GREY, RED, figure

from .figures import ALL_SPRINGS, FEATURE, STATE_TRAFFIC

_COLORS = {"gather": RED, "edge": BLUE, "numba strided": GREEN}
# By the rank of a thread count among those measured, which are three at most.
_LINES = ("o-", "s--", "^-.")
_SHADES = (1.0, 0.6, 0.3)


def _legend(panel: Any) -> None:
    """Place the legend below the figure, where it hides no curve."""
    lines = panel.get_legend_handles_labels()
    panel.figure.legend(*lines, loc="outside lower center", ncols=4, fontsize="small")


def _on(threads: int) -> str:
    return f"{threads} thread{'s' * (threads > 1)}"


def _grids(report: dict[str, Any]) -> Any:
    names = {f"grid {rows}" for rows in report["settings"]["sizes"]}
    figures = [f for f in report["figures"] if f["work"] in names and f["threads"]]
    if not figures:
        return None
    from matplotlib.ticker import LogLocator, NullLocator

    counts = sorted({f["threads"] for f in figures})
    drawn, (panels,) = figure(11, 5.2, 1, 2, sharey=True)
    for panel, precision in zip(panels, ("single", "double"), strict=True):
        chosen = [f for f in figures if f["precision"] == precision]
        for by, threads in dict.fromkeys((f["by"], f["threads"]) for f in chosen):
            line = sorted(
                (f["points"], 1e9 * f["minimum"] / f["points"]) for f in chosen if (f["by"], f["threads"]) == (by, threads)
            )
            panel.plot(
                *zip(*line, strict=True),
                _LINES[counts.index(threads)],
                ms=4,
                color=_COLORS.get(by, GREY),
                label=f"{by}, {_on(threads)}",
            )
        if report["limits"]:
            for threads in dict.fromkeys((counts[0], counts[-1])):
                color = "k" if threads == counts[-1] else "0.6"
                _limit_lines(panel, report, precision, chosen, threads, color)
        panel.set(yscale="log", title=precision, xlabel="mass points (rows x columns)")
        panel.set_xscale("log", base=2)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_minor_locator(NullLocator())
        panel.yaxis.set_major_formatter("{x:g}")
    panels[0].set_ylabel("ns per mass point and step")
    _legend(panels[0])
    return drawn


def _limit_lines(
    panel: Any, report: dict[str, Any], precision: str, figures: list[dict[str, Any]], threads: int, color: str
) -> None:
    """The time of the leanest kernel's flops at the peak, and of its traffic through memory."""
    limits = report["limits"]
    isa = report["machine"]["build"]["instruction_set"]
    labels = {"instruction_set": isa, "precision": precision, "threads": threads}
    peak = next(p for p in limits["peak"] if all(p[k] == v for k, v in labels.items()))
    counted = [f for f in figures if f["flops"]]
    by = min(counted, key=lambda f: f["flops"] / f["points"])["by"]
    compute = sorted(
        {(f["points"], 1e9 * f["flops"] / f["points"] / peak["flops_per_second"]) for f in counted if f["by"] == by}
    )
    look = {"color": color, "lw": 1.2}
    panel.plot(*zip(*compute, strict=True), ls=":", label=f"flops at peak, {_on(threads)}", **look)
    memory = 1e9 * STATE_TRAFFIC / limits["bandwidth"][threads]
    name = f"{STATE_TRAFFIC} bytes from memory, {_on(threads)}"
    panel.axhline(memory, ls="-.", label=name, **look)


def _bars(panel: Any, labels: list[str], groups: Sequence[tuple[str, str, int, list[float]]]) -> None:
    """Bars of each group, which is a name, the kernel of its colour, its shade and its values."""
    height = 0.8 / len(groups)
    for k, (name, by, shade, values) in enumerate(groups):
        at = [i + (k - (len(groups) - 1) / 2) * height for i in range(len(labels))]
        look = {"color": _COLORS.get(by, GREY), "alpha": _SHADES[shade]}
        bars = panel.barh(at, values, height, label=name, **look)
        panel.bar_label(bars, fmt="%.1f", fontsize="x-small", padding=2)
    panel.set_yticks(range(len(labels)), labels)
    panel.margins(y=0.02)
    panel.invert_yaxis()
    _legend(panel)


def _threads(report: dict[str, Any]) -> Any:
    figures = [f for f in report["figures"] if f["work"] in ("static", "static+bend")]
    if not figures:
        return None
    works = list(dict.fromkeys((f["springs"], f["precision"]) for f in figures))
    counts = sorted({f["threads"] for f in figures})
    groups = []
    for by, threads in sorted({(f["by"], f["threads"]) for f in figures}):
        times = {
            (f["springs"], f["precision"]): 1e6 * f["minimum"] for f in figures if (f["by"], f["threads"]) == (by, threads)
        }
        values = [times[work] for work in works]
        groups.append((f"{by}, {_on(threads)}", by, counts.index(threads), values))
    drawn, ((panel,),) = figure(8, 4.5)
    _bars(panel, [f"{springs:,} springs\n{precision}" for springs, precision in works], groups)
    panel.axvline(5.0, color=GREY, lw=1, ls=":")
    panel.set_xlabel("us per step of 32 x 32 mass points (dotted: real time at the paper's 5 us)")
    return drawn


def _features(report: dict[str, Any]) -> Any:
    figures = [f for f in report["figures"] if f["work"].startswith(FEATURE)]
    if not any(f["work"] == ALL_SPRINGS for f in figures):
        return None
    works = list(dict.fromkeys(f["work"] for f in figures))
    groups = []
    for by, precision in dict.fromkeys((f["by"], f["precision"]) for f in figures):
        times = {f["work"]: 1e6 * f["minimum"] for f in figures if (f["by"], f["precision"]) == (by, precision)}
        values = [times[work] for work in works]
        groups.append((f"{by}, {precision}", by, int(precision == "double"), values))
    drawn, ((panel,),) = figure(8, 8)
    _bars(panel, [work.removeprefix(FEATURE) for work in works], groups)
    panel.set_xlabel("us per step of 32 x 32 mass points, one thread")
    return drawn


ALL = {"grids": _grids, "threads": _threads, "features": _features}
"""Each draws its plot of a report, or returns None where there is nothing to draw."""
