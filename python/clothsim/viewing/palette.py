"""Colour scales of pictures: a value per mass point becomes a colour that every reader can order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Floats, check
from .packing import point_stretch

# Stops at equal distances, dark to light or light to dark: lightness alone orders them. The pages have the same.
VIRIDIS = ("440154", "472c7a", "3b518b", "2c718e", "21908d", "27ad81", "5cc863", "aadc32", "fde725")
HEAT = ("ffffcc", "ffeda0", "fed976", "feb24c", "fd8d3c", "fc4e2a", "e31a1c", "bd0026", "800026")
# Part of all values that a scale holds. At half, folds are lost above it; pins stretch the last hundredth five times as far.
TOP_PART = 0.99
UNKNOWN = np.array([0.5, 0.5, 0.5])  # a value that is not finite
TITLES = {"stretch": ("stretch", "%", 100.0), "speed": ("speed", "m/s", 1.0), "depth": ("depth", "mm", 1000.0)}
NAMES = ("faces", *TITLES)


@dataclass(frozen=True)
class Scale:
    """A colour scale from `low` to `high`, with the title and unit that its bar shows."""

    title: str
    unit: str
    factor: float  # from SI to `unit`
    low: float
    high: float
    stops: tuple[str, ...]
    open_end: bool  # whether a value lies above `high`

    def colors(self, values: Floats) -> Floats:
        """The colours of values, shape (..., 3), 0 to 1."""
        stops = np.array([[int(stop[k : k + 2], 16) for k in (0, 2, 4)] for stop in self.stops]) / 255
        part = (np.asarray(values, float) - self.low) / ((self.high - self.low) or 1.0)
        places = np.linspace(0, 1, len(stops))
        colors = np.stack([np.interp(part, places, stops[:, k]) for k in range(3)], -1)
        return np.where(np.isfinite(part)[..., None], colors, UNKNOWN)


def values_of(color: Any, scene: Any, x: Floats, v: Floats | None, t: Floats) -> Floats | None:
    """The value at each mass point of states of shape (frames, rows, columns, 3), or None for the faces' colours."""
    if isinstance(color, str):
        check.choice("color", color, NAMES)
        if color == "faces":
            return None
        if color == "stretch":
            return point_stretch(scene, x).reshape(x.shape[:-1])
        if color == "speed":
            if v is None:
                raise ValueError('v must be given with color="speed", got None')
            return np.array([np.linalg.norm(one, axis=-1) for one in v])
        depth = np.zeros(x.shape[:-1])
        for sphere in scene.spheres:
            for deepest, points, center in zip(depth, x, np.reshape(sphere.center_at(t), (-1, 3))):
                np.maximum(deepest, sphere.radius - np.linalg.norm(points - center, axis=-1), out=deepest)
        return depth
    accepted = f"one of {', '.join(map(repr, NAMES))}, or numbers of shape {x.shape[1:-1]}"
    accepted += f" or {x.shape[:-1]}" if len(x) > 1 else ""
    values = check.as_array("color", color, accepted)
    if values.dtype.kind not in "iufb" or values.shape not in (x.shape[:-1], x.shape[1:-1]):
        raise ValueError(f"color must be {accepted}, got {check.shown(color)}")
    return np.broadcast_to(values.astype(float), x.shape[:-1])


def scale_of(color: Any, values: Floats, limits: Any) -> Scale:
    """The scale of all `values`, which begins at 0 for the named ones, or lies between `limits` in SI units."""
    known = values[np.isfinite(values)]
    title, unit, factor = TITLES[color] if isinstance(color, str) else ("", "", 1.0)
    if limits is not None:
        low, high = (check.number("limits", k) for k in check.items("limits", limits, 2, "numbers"))
        if low >= high:
            raise ValueError(f"limits must be two rising numbers, got {limits!r}")
    elif not known.size:
        low, high = 0.0, 1.0
    elif isinstance(color, str):
        low, high = 0.0, float(np.quantile(known, TOP_PART)) or float(known.max()) or 1 / factor
    else:
        low, high = float(known.min()), float(known.max())
    above = bool(known.size and known.max() > high)
    return Scale(title, unit, factor, low, high, HEAT if unit == "mm" else VIRIDIS, above)
