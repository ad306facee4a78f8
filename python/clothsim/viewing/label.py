"""The label of a picture: a strip with the time, a length and the colour scale, or with a title."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..base.extras import import_from_extra
from .scale import Scale

Pixels = npt.NDArray[np.uint8]

INK = (40, 40, 40)
LEAST_WIDTH = 320  # pixels; in a narrower picture the label cannot be read


def round_length(most: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `most`."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(k * power for k in (1, 2, 5) if k * power <= most * (1 + 1e-9))


def length_in_words(length: float) -> str:
    """Return a length in m, cm or mm."""
    for unit, size in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)):
        if length >= size * (1 - 1e-9):
            return f"{length / size:g} {unit}"
    return f"{length:g} m"


def add_title(pixels: Pixels, title: str) -> Pixels:
    """Return the picture below a strip with its title, or as much of it as there is room for."""
    image, pen, fonts = (
        import_from_extra(f"PIL.{name}", "a picture of several runs", "plot")
        for name in ("Image", "ImageDraw", "ImageFont")
    )
    width = pixels.shape[1]
    size = max(10.0, width / 32)
    font = fonts.load_default(size)
    shown = title
    end = len(title)
    while font.getlength(shown) > 0.96 * width:
        end -= 1
        shown = f"{title[:end]}..."
    strip = image.new("RGB", (width, round(1.6 * size)), "white")
    pen.Draw(strip).text((width / 2, 0.8 * size), shown, INK, font, anchor="mm")
    return np.concatenate([np.asarray(strip), pixels])


def add_label(
    pixels: Pixels, t: float, pixels_per_metre: float, scale: Scale | None, note: str = ""
) -> Pixels:
    """Return the picture above a strip that shows the time [s], a length, and the colour scale.

    A note has a line above these.
    """
    image, pen, fonts = (
        import_from_extra(f"PIL.{name}", "label=True", "plot")
        for name in ("Image", "ImageDraw", "ImageFont")
    )
    width = pixels.shape[1]
    cell = width / LEAST_WIDTH
    base = (25 if note else 12) * cell
    edge = 5 * cell
    font = fonts.load_default(10 * cell)
    strip = image.new("RGB", (width, round(base + 5 * cell)), "white")
    draw = pen.Draw(strip)
    if note:
        draw.text((edge, 10 * cell), note, INK, font, anchor="ls")
    draw.text((edge, base), f"t = {t:.4f} s", INK, font, anchor="ls")
    length = round_length(0.17 * width / pixels_per_metre)
    left = 0.26 * width
    right = left + length * pixels_per_metre
    line = max(1, round(0.8 * cell))
    for x0, x1, high in (
        (left, right, line),
        (left, left + line, 4 * cell),
        (right - line, right, 4 * cell),
    ):
        draw.rectangle((round(x0), round(base - high), round(x1) - 1, round(base) - 1), INK)
    draw.text((right + 2.5 * cell, base), length_in_words(length), INK, font, anchor="ls")
    if scale is not None:
        low, high = (f"{scale.factor * end:.3g}" for end in (scale.low, scale.high))
        high = f"{'>' if scale.open_end else ''}{high} {scale.unit}".rstrip()
        draw.text((width - edge, base), high, INK, font, anchor="rs")
        right = round(width - edge - draw.textlength(high, font) - 2.5 * cell)
        left = round(right - 0.13 * width)
        bar = scale.colors(np.linspace(scale.low, scale.high, right - left))
        bar = np.broadcast_to(bar, (round(7 * cell), *bar.shape))
        strip.paste(
            image.fromarray(np.round(255 * bar).astype(np.uint8)), (left, round(base) - len(bar))
        )
        draw.text(
            (left - 2.5 * cell, base), f"{scale.title} {low}".lstrip(), INK, font, anchor="rs"
        )
    return np.concatenate([pixels, np.asarray(strip)])
