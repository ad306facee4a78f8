"""Frames of a run as few bytes: positions in 16 bits, values of the points in 8, deflated.

Positions of a run are integers q, 0 to 65535, between its lowest and highest coordinate on each
axis: x = low + step q. Their error is at most step / 2, which is 15 um for a scene of 2 m. Second differences in time,
q[k] - 2 q[k-1] + q[k-2], are small integers where a cloth moves smoothly. Their low bytes and high bytes are stored
apart, which makes nearly all high bytes 0 and lets deflate remove them.

A value is stored as 255 levels of its square root: the reader may colour by a small part of the largest value.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..model.scene import Scene

LEVELS = 65535
TOP_PARTS = {"max": 1.0, "99 %": 0.99, "90 %": 0.9}
"""Part of all values that a colour scale of the page holds, by the name of the choice."""


@dataclass(frozen=True)
class Packed:
    """`data` holds the frames; see the module. `low` and `step` [m] have one entry per axis."""

    data: bytes
    low: npt.NDArray[np.float64]
    step: npt.NDArray[np.float64]

    @property
    def precision(self) -> float:
        """Largest error of a stored coordinate [m]."""
        return float(self.step.max() / 2)


def pack(x: npt.NDArray[np.float64], scalars: list[npt.NDArray[np.float64]], tops: list[float]) -> Packed:
    """Positions, shape (frames, rows, columns, 3), and values, shape (frames, points), up to `tops`."""
    frames = len(x)
    flat = x.reshape(frames, -1, 3)
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    step = (high - low) / LEVELS
    # Frame by frame, and deflated piece by piece: Ctrl-C acts in between.
    zigzag = np.empty((frames, flat[0].size), np.uint16)
    last = rate = np.zeros(flat[0].size, np.int64)
    for k, points in enumerate(flat):
        q = np.round((points - low) / np.where(step > 0, step, 1.0)).astype(np.int64).T.reshape(-1)
        signed = (q - last - rate).astype(np.int16).astype(np.int32)  # modulo 65536, and back
        zigzag[k] = (signed << 1) ^ (signed >> 31)  # 0, -1, 1, -2, ... are 0, 1, 2, 3
        last, rate = q, q - last if k else rate
    deflate = zlib.compressobj(6)
    data = [deflate.compress((one & 255).astype(np.uint8).tobytes()) for one in zigzag]
    data += [deflate.compress((one >> 8).astype(np.uint8).tobytes()) for one in zigzag]
    for values, top in zip(scalars, tops, strict=True):
        before = np.zeros(values.shape[1:], np.uint8)
        for one in values:
            levels = np.round(255 * np.sqrt(np.clip(one / (top or 1.0), 0, 1))).astype(np.uint8)
            data.append(deflate.compress((levels - before).tobytes()))
            before = levels
    return Packed(b"".join([*data, deflate.flush()]), low, step)


def point_stretch(
    scene: Scene, x: npt.NDArray[np.float64], advance: Callable[[int], object] = lambda _: None
) -> npt.NDArray[np.float64]:
    """Stretch l/L - 1 of the most stretched spring at each point, shape (frames, points), >= 0.

    `advance` is called with 1 after each frame.
    """
    table = scene.cloth.spring_table()
    i, j, rest = table["i"], table["j"], table["rest_length"]
    found = np.zeros((len(x), x.shape[1] * x.shape[2]))
    for values, points in zip(found, x.reshape(len(x), -1, 3), strict=True):
        stretch = np.linalg.norm(points[j] - points[i], axis=-1) / rest - 1
        np.maximum.at(values, i, stretch)
        np.maximum.at(values, j, stretch)
        advance(1)
    return found


def tops_of(values: list[npt.NDArray[np.float64]]) -> dict[str, float]:
    """The choices of a top of a colour scale that all arrays of `values` share."""
    return {name: max(float(np.quantile(each, part)) for each in values) for name, part in TOP_PARTS.items()}
