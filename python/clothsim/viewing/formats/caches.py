"""Point caches: positions of every frame as one array, for a mesh that another file holds.

PC2 (3ds Max, Blender) has a frame rate; MDD (LightWave, Blender) has a time for every frame.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ..clip import Clip
from .ball import bodies
from .sequences import write_obj


def write(clip: Clip, path: Path) -> list[Path]:
    with path.open("wb") as file:
        file.write(_pc2_header(clip) if path.suffix.lower() == ".pc2" else _mdd_header(clip))
        order = "<f4" if path.suffix.lower() == ".pc2" else ">f4"
        for frame in clip.frames():
            file.write(frame.positions.astype(order).tobytes())
    mesh = path.with_suffix(".obj")
    write_obj(bodies(clip, clip[0])[:1], mesh)  # a cache moves one mesh
    return [path, mesh]


def _pc2_header(clip: Clip) -> bytes:
    """Signature, version, points, first frame, frames a sample, samples; little-endian."""
    if clip.fps is None:
        steps = np.diff(clip.times)
        if np.ptp(steps) > 1e-6 * steps.max():
            raise ValueError(
                "fps must be a number for .pc2, which holds frames at equal distances: the stored "
                f"frames are {steps.min():.6g} to {steps.max():.6g} s apart"
            )
    points = clip.triangles.max() + 1
    return struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, 0.0, 1.0, len(clip))


def _mdd_header(clip: Clip) -> bytes:
    """Frames, points and the time of each frame [s]; big-endian."""
    points = clip.triangles.max() + 1
    return struct.pack(">ii", len(clip), points) + clip.times.astype(">f4").tobytes()
