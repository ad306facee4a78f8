"""Derivatives over time and over the points: the plot of `sensitivity`."""

from __future__ import annotations

from typing import Any

import numpy as np

from .style import BLACK, BLUE, FEW, RED, axes_to_show, wrap_text

_MOST_TICKS = 8  # numbers of rows or columns


def draw_sensitivity(data: Any, ax: Any = None) -> Any:
    """Draw each derivative over time, with its error, and over the points at one time.

    Each parameter has a row of two axes, of shape (parameters, 2) in all. At the left are the
    derivative of the point that moves most and the error, at the right all points at the time at
    which the derivative is largest.
    """
    count = data.sizes["parameter"]
    panels = axes_to_show(ax, 2, count, width=10.0, height=0.6 + 2.5 * count)
    grid = np.array(panels).reshape(count, 2)
    for row, (over_time, over_points) in enumerate(grid):
        parameter = data.isel(parameter=row)
        unit = str(parameter["unit"].item())
        per = "[m]" if unit in ("", "1") else f"[m per {unit}]"
        length = np.linalg.norm(parameter["dx"].values, axis=-1)  # (times, rows, columns)
        _draw_over_time(parameter, length, over_time)
        over_time.set_ylabel(per)
        _draw_over_points(parameter, length, per, over_points)
    grid[-1, 0].set_xlabel("time [s]")
    return grid


def _draw_over_time(parameter: Any, length: np.ndarray, axes: Any) -> None:
    """Draw the largest derivative of a point and its error at each time."""
    times = parameter["time"].values
    marks: dict[str, Any] = {"marker": "o", "ms": 3} if len(times) < FEW else {}
    largest = length.max(axis=(1, 2))
    for values, text, color, dash in (
        (largest, "largest of a point", BLUE, "-"),
        (parameter["error"].values, "error", RED, "--"),
    ):
        if (values > 0).any():
            positive = np.where(values > 0, values, np.nan)
            axes.plot(times, positive, label=text, color=color, ls=dash, **marks)
    axes.set(yscale="log", xlim=(0, 1.05 * times[-1]))
    if axes.lines:
        axes.legend(fontsize="small")
    title = f"d x / d {parameter['parameter'].item()}"
    reason = parameter["reason"].item()
    if reason:
        end = parameter["known_until"].item()
        axes.axvline(end, color=BLACK, ls=":", lw=1)
        title = f"{title}\n{wrap_text(reason, axes)}"
    axes.set_title(title, fontsize="medium", loc="left")


def _draw_over_points(parameter: Any, length: np.ndarray, unit: str, axes: Any) -> None:
    """Draw the derivative of each point at the time at which the largest is."""
    largest = np.nan_to_num(length.max(axis=(1, 2)), nan=-1.0)
    k = int(largest.argmax())
    values = length[k]
    axes.grid(False)
    if not largest[k] > 0:
        text = "not known at any time" if largest[k] < 0 else "no effect on any point"
        axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    image = axes.imshow(values, vmin=0.0, cmap="viridis", aspect="auto")
    axes.figure.colorbar(image, ax=axes, label=unit)
    time = parameter["time"].values[k]
    axes.set(xlabel="column", ylabel="row", title=f"at {time:.4g} s")
    axes.title.set_fontsize("medium")
    for axis, count in ((axes.xaxis, values.shape[1]), (axes.yaxis, values.shape[0])):
        axis.set_ticks(np.arange(0, count, -(-count // _MOST_TICKS)))
