"""What the colours and lengths of a picture mean: values of mass points, colour scales, and the label below a picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base import Floats, check

Pixels = npt.NDArray[np.uint8]

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


def point_stretch(scene: Any, x: Floats, advance: Callable[[int], object] = lambda _: None) -> Floats:
    """Stretch l/L - 1 of the most stretched spring at each point, shape (frames, points), >= 0; `advance` by 1 a frame."""
    table = scene.cloth.spring_table()
    i, j, rest = table["i"], table["j"], table["rest_length"]
    found = np.zeros((len(x), x.shape[1] * x.shape[2]))
    for values, points in zip(found, x.reshape(len(x), -1, 3), strict=True):
        stretch = np.linalg.norm(points[j] - points[i], axis=-1) / rest - 1
        np.maximum.at(values, i, stretch)
        np.maximum.at(values, j, stretch)
        advance(1)
    return found


# Strokes on a grid 4 wide. Each pair of digits is x and y, the base line at y = 2. Small letters reach 6, digits 8.
STROKES = {
    "0": "123243473818070312", "1": "1728 2822 1232", "2": "07183847460242", "3": "07183847463544433212 35 1203 3515",
    "4": "32380444", "5": "480805354443321203", "6": "4738180703123243443505", "7": "084812",
    "8": "153546473818070615 150403123243443515", "9": "0312324347381807061545", "a": "16364542 433212031444",
    "c": "4536160503123243", "d": "4842 4536160503123243", "e": "044445361605031242", "h": "0802 0516364542",
    "i": "2622 2828", "k": "0802 3604 0432", "l": "18132232", "m": "0602 05162522 25364542", "n": "0602 0516364542",
    "p": "0600 0516364543321203", "r": "0602 04152636", "s": "4616051434433202", "t": "18132232 0636",
    "u": "0603123243 4642", "v": "062246", ".": "2222", "-": "0545", "+": "0545 2327",
    "%": "0717180807 3242433332 0248", "=": "0646 0444", "/": "0148", ">": "074503 0242", " ": "",
}  # fmt: skip
ADVANCE, HEIGHT = 5.6, 6.0  # of a letter, and of a digit above the base line, in cells of the grid
INK = 40.0  # of 255
LEAST_WIDTH = 320  # pixels; in a narrower picture the label cannot be read


@lru_cache(maxsize=256)
def _glyph(letter: str, cell: float) -> Floats:
    """Coverage of a letter's pixels, whose row 0 is 9 cells above its lowest."""
    half = max(0.55, 0.4 * cell)  # of a stroke's width
    height, width = math.ceil(10 * cell), math.ceil((ADVANCE + 1) * cell)
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = x - cell, 9 * cell - y
    cover = np.zeros((height, width))
    for stroke in STROKES[letter].split():
        points = [(cell * int(stroke[k]), cell * int(stroke[k + 1])) for k in range(0, len(stroke), 2)]
        for (x0, y0), (x1, y1) in zip(points, points[1:]):
            dx, dy = x1 - x0, y1 - y0
            along = ((x - x0) * dx + (y - y0) * dy) / ((dx * dx + dy * dy) or 1.0)
            along = along.clip(0, 1)
            distance = np.hypot(x - x0 - along * dx, y - y0 - along * dy)
            cover = np.maximum(cover, (half + 0.5 - distance).clip(0, 1))
    return cover


def write(pixels: Pixels, text: str, left: float, base: int, cell: float) -> float:
    """Write `text` with its base line at row `base`. Return the column at its right end."""
    top = base - round(7 * cell)
    for letter in text:
        cover = _glyph(letter, cell)
        first = round(left - cell)
        below = pixels[max(top, 0) : top + len(cover), max(first, 0) : first + cover.shape[1]]
        cover = cover[max(-top, 0) :, max(-first, 0) :][: below.shape[0], : below.shape[1], None]
        below[:] = np.round(below + cover * (INK - below)).astype(np.uint8)
        left += ADVANCE * cell
    return left


def nice_length(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(k * power for k in (1, 2, 5) if k * power <= most * (1 + 1e-9))


def length_in_words(length: float) -> str:
    """A length in m, cm or mm."""
    for unit, size in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if length >= size * (1 - 1e-9):
            return f"{length / size:g} {unit}"
    return f"{length:g} m"


def labelled(pixels: Pixels, t: float, pixels_per_metre: float, scale: Scale | None, note: str = "") -> Pixels:
    """The picture above a strip that shows the time [s], a length, and the colour scale; a note has a strip above it."""
    width = pixels.shape[1]
    cell = width / 320
    strip = np.full((round(16 * cell), width, 3), 255, np.uint8)
    base, edge = round(10.5 * cell), 5 * cell
    write(strip, f"t = {t:.4f} s", edge, base, cell)
    length = nice_length(0.17 * width / pixels_per_metre)
    left, right = 0.26 * width, 0.26 * width + length * pixels_per_metre
    thick = max(1, round(0.8 * cell))
    strip[base - thick : base, round(left) : round(right)] = int(INK)
    for end in (left, right - thick):
        strip[base - round(4 * cell) : base, round(end) : round(end) + thick] = int(INK)
    write(strip, length_in_words(length), right + 2.5 * cell, base, cell)
    if scale is not None:
        _write_scale(strip, scale, base, cell, edge)
    if not note:
        return np.concatenate([pixels, strip])
    line = np.full((round(12 * cell), width, 3), 255, np.uint8)
    write(line, note, edge, round(8.5 * cell), cell)
    return np.concatenate([pixels, line, strip])


def _write_scale(strip: Pixels, scale: Scale, base: int, cell: float, edge: float) -> None:
    """The colour bar between its ends, at the right of the strip."""
    width = strip.shape[1]
    ends = [f"{scale.factor * end:.3g}" for end in (scale.low, scale.high)]
    high = f"{'>' if scale.open_end else ''}{ends[1]} {scale.unit}".rstrip()
    write(strip, high, width - edge - len(high) * ADVANCE * cell, base, cell)
    right = round(width - edge - len(high) * ADVANCE * cell - 2.5 * cell)
    left = round(right - 0.13 * width)
    part = scale.low + (scale.high - scale.low) * (np.arange(right - left) + 0.5) / (right - left)
    strip[base - round(HEIGHT * cell) : base, left:right] = np.round(255 * scale.colors(part)).astype(np.uint8)
    title = f"{scale.title} {ends[0]}".lstrip()
    write(strip, title, left - 2.5 * cell - len(title) * ADVANCE * cell, base, cell)
