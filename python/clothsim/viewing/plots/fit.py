"""Data and fitted motion, residuals, values with errors, and correlations: the plot of `fit`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ...accuracy.parameters import parameters_of
from ...model.fields import unit_of_name
from .points import distant_points
from .style import BLACK, BLUE, COLORS, GREY, MARKERS, axes_to_show, wrap_text

if TYPE_CHECKING:
    from ...accuracy.fit import Fit

_TWO_LINES = 0.34  # inches, height of a parameter's row in which its label has two lines


def draw_fit(result: Fit, ax: Any = None) -> Any:
    """Draw `Fit.plot`."""
    names = [name for name, error in result.errors.items() if error > 0]
    if ax is None and len(names) > 1:
        panels = axes_to_show(None, 2, 2, width=12.0, height=8.0)
    elif len(names) > 1:
        panels = axes_to_show(ax, 4)
    else:
        panels = axes_to_show(ax, 3, width=15.0, height=4.2)
    _draw_motion(result, panels[0])
    _draw_residuals(result, panels[1])
    _draw_values(result, panels[2])
    if len(names) > 1:
        _draw_correlation(result, names, panels[3])
    return np.array(panels)


def _draw_motion(result: Fit, axes: Any) -> None:
    """Draw measured and fitted positions of some points that are far from each other."""
    data = result.positions.reshape(len(result.times), -1, 3)
    fitted = data - result.residuals.reshape(data.shape)
    sides = result.positions.shape[1:-1]
    for n, (k, component) in enumerate(distant_points(data)):
        place = tuple(map(int, np.unravel_index(k, sides)))
        name = f"point {place}" if len(place) > 1 else f"points[{k}]"
        marks = {"color": COLORS[n], "marker": MARKERS[n], "ms": 4, "ls": "none"}
        label = f"{'xyz'[component]} of {name}"
        axes.plot(result.times, data[:, k, component], label=label, **marks)
        axes.plot(result.times, fitted[:, k, component], color=COLORS[n])
    axes.set(xlabel="time [s]", ylabel="position [m]")
    axes.set_title("measured (marks), fitted (lines)", fontsize="medium")
    axes.legend(fontsize="small")


def _draw_residuals(result: Fit, axes: Any) -> None:
    """Draw the residuals of all numbers over time."""
    residuals = 1e3 * result.residuals.reshape(len(result.times), -1)
    axes.plot(result.times, residuals, ".", ms=3, color=BLUE, alpha=0.5)
    for side in (-1, 1):
        axes.axhline(side * 2e3 * result.report["sigma"], color=GREY, ls="--")
    axes.set(xlabel="time [s]", ylabel="measured less fitted [mm]")
    axes.set_title("residuals; dashed: 2 sigma", fontsize="medium")


def _draw_values(result: Fit, axes: Any) -> None:
    """Draw the error of each parameter over its value; texts have the numbers, or the reason."""
    parameters = parameters_of(result.scene, [*result.values], "over")
    rows = np.arange(len(parameters))
    errors = np.array([result.errors[p.name] for p in parameters])
    parts = 100 * errors / [p.scale or math.nan for p in parameters]
    height = axes.get_window_extent().height / axes.figure.dpi / len(parameters)
    separator = "\n" if height > _TWO_LINES else "  "
    labels = []
    for row, parameter in enumerate(parameters):
        name = parameter.name
        text = value_with_error(result.values[name], errors[row], unit_of_name(parameter.field))
        labels.append(f"{name}{separator}{text}")
        if not math.isfinite(errors[row]):
            reason = result.report["reasons"][name] or result.report["reason"]
            where = {"transform": axes.get_yaxis_transform(), "ha": "center", "va": "center"}
            axes.text(0.5, row, wrap_text(reason, axes), fontsize="small", **where)
    finite = np.isfinite(parts)
    if finite.any():
        widest = 1.2 * parts[finite].max()
        axes.axvline(0.0, color=GREY, lw=0.8)
        axes.errorbar(
            0 * parts[finite], rows[finite], xerr=parts[finite], fmt="o", color=BLUE, capsize=4
        )
        axes.set(xlim=(-widest, widest), xlabel="error [% of the value or scale]")
    else:
        axes.set_xticks([])
    axes.set_yticks(rows, labels, fontsize="small")
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(False, axis="y")
    axes.set_title("values and errors (one sigma)", fontsize="medium")


def value_with_error(value: float, error: float, unit: str) -> str:
    """Return a value and its error with two digits of the error, such as "60.21 ± 0.34 N/m"."""
    if math.isnan(value):
        return "unknown"
    if math.isnan(error):
        return f"{value:.6g} {unit}".rstrip() + ", error unknown"
    power = math.floor(math.log10(max(abs(value), error) or 1.0))
    shown = 0 if -4 < power < 6 else power  # the power of ten that both share
    digits = shown + 1 - math.floor(math.log10(error)) if error > 0 else 6
    numbers = [f"{number / 10.0**shown:.{max(digits, 0)}f}" for number in (value, error)]
    text = " \u00b1 ".join(numbers)
    if shown:
        text = f"({text})e{shown}"
    return f"{text} {unit}".rstrip()


def _draw_correlation(result: Fit, names: list[str], axes: Any) -> None:
    """Draw the correlation matrix of the named parameters."""
    rows = [[*result.values].index(name) for name in names]
    covariance = result.covariance[np.ix_(rows, rows)]
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    axes.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    for i, j in np.ndindex(correlation.shape):
        color = "white" if abs(correlation[i, j]) > 0.6 else BLACK
        where = {"ha": "center", "va": "center"}
        axes.text(j, i, f"{correlation[i, j]:.2f}", fontsize="small", color=color, **where)
    turn = {"rotation": 30, "ha": "right", "rotation_mode": "anchor", "fontsize": "small"}
    axes.set_xticks(range(len(names)), names, **turn)
    axes.set_yticks(range(len(names)), names, fontsize="small")
    axes.set_title("correlations", fontsize="medium")
    axes.grid(False)
