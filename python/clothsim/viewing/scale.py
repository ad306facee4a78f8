"""Values of mass points, and the colour scale that shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Floats, check

# The stops have equal distances, from dark to light or from light to dark, so lightness alone
# orders them. The pages have the same.
VIRIDIS = ("440154", "472c7a", "3b518b", "2c718e", "21908d", "27ad81", "5cc863", "aadc32", "fde725")
HEAT = ("ddc377", "dfa95c", "df8545", "d75d33", "c73a27", "b02521", "99181f", "7c0e1b", "5f0515")
# Part of all values that a scale holds. At a half, folds would be lost above it; pins stretch the
# last hundredth five times as far.
TOP_PART = 0.99
LEAST_DEPTH = 1e-3  # m, end of the scale where nothing is inside
UNKNOWN = np.array([0.5, 0.5, 0.5])  # colour of a value that is not finite
TITLES = {
    "stretch": ("stretch", "%", 100.0),
    "speed": ("speed", "m/s", 1.0),
    "depth": ("depth", "mm", 1000.0),
}
NAMES = ("faces", *TITLES)


@dataclass(frozen=True)
class Scale:
    """A colour scale from `low` to `high`, with the title and unit that its bar shows."""

    title: str
    unit: str
    factor: float  # factor from SI to `unit`
    low: float
    high: float
    stops: tuple[str, ...] = VIRIDIS
    open_end: bool = False  # True if a value lies above `high`

    def stop_colors(self) -> Floats:
        """Return the colours of the stops as RGB in [0, 1]."""
        stops = [[int(stop[k : k + 2], 16) for k in (0, 2, 4)] for stop in self.stops]
        return np.array(stops) / 255

    def colors(self, values: Floats) -> Floats:
        """Return the colours of values, shape (..., 3), 0 to 1."""
        part = (np.asarray(values, float) - self.low) / ((self.high - self.low) or 1.0)
        places = np.linspace(0, 1, len(self.stops))
        colors = np.stack([np.interp(part, places, stop) for stop in self.stop_colors().T], -1)
        return np.where(np.isfinite(part)[..., None], colors, UNKNOWN)


def point_values(color: Any, scene: Any, x: Floats, v: Floats | None) -> Floats | None:
    """Return the value of each mass point, or None where points have none.

    States have the shape (frames, rows, columns, 3).
    """
    if isinstance(color, str):
        check.choice("color", color, NAMES)
        if color == "stretch":
            return point_stretch(scene, x).reshape(x.shape[:-1])
        if color != "speed":
            return None
        if v is None:
            raise ValueError('v must be given with color="speed", got None')
        return np.array([np.linalg.norm(frame, axis=-1) for frame in v])
    accepted = f"one of {', '.join(map(repr, NAMES))}, or numbers of shape {x.shape[1:-1]}"
    accepted += f" or {x.shape[:-1]}" if len(x) > 1 else ""
    values = check.as_array("color", color, accepted, "iufb")
    if values.shape not in (x.shape[:-1], x.shape[1:-1]):
        raise ValueError(f"color must be {accepted}, got {check.value_text(color)}")
    return np.broadcast_to(values.astype(float), x.shape[:-1])


def make_scale(color: Any, values: Floats, limits: Any) -> Scale:
    """Return the scale of all `values`: between `limits` [SI] if there are any.

    Without limits, the scale of a named value begins at 0.
    """
    finite = values[np.isfinite(values)]
    title, unit, factor = TITLES[color] if isinstance(color, str) else ("", "", 1.0)
    if limits is not None:
        low, high = (
            check.number("limits", k) for k in check.list_of_items("limits", limits, 2, "numbers")
        )
        if low >= high:
            raise ValueError(f"limits must be two rising numbers, got {limits!r}")
    elif not finite.size:
        low = 0.0
        high = 1.0
    elif title == "depth":
        low = 0.0
        high = float(finite.max()) or LEAST_DEPTH
    elif title:
        low = 0.0
        high = float(np.quantile(finite, TOP_PART)) or float(finite.max()) or 1 / factor
    else:
        low = float(finite.min())
        high = float(finite.max())
    return Scale(
        title=title,
        unit=unit,
        factor=factor,
        low=low,
        high=high,
        stops=HEAT if title == "depth" else VIRIDIS,
        open_end=bool(finite.size and finite.max() > high),
    )


def point_stretch(scene: Any, x: Floats) -> Floats:
    """Return the stretch l/L - 1 of the most stretched spring at each point, >= 0.

    The shape is (frames, points).
    """
    table = scene.cloth.spring_table()
    i = table["i"]
    j = table["j"]
    largest = np.zeros((len(x), x.shape[1] * x.shape[2]))
    for values, points in zip(largest, x.reshape(len(x), -1, 3), strict=True):
        stretch = np.linalg.norm(points[j] - points[i], axis=-1) / table["rest_length"] - 1
        np.maximum.at(values, i, stretch)
        np.maximum.at(values, j, stretch)
    return largest
