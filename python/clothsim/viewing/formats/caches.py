"""PC2 (3ds Max, Blender): positions of every frame as one array, for a mesh that another file holds."""

from __future__ import annotations

import struct
from pathlib import Path

from ..clip import Clip
from .ball import bodies
from .sequences import write_obj


def write(clip: Clip, path: Path) -> list[Path]:
    if clip.fps is None:
        raise ValueError("fps must be a number for .pc2, which holds frames at equal distances: those of the run are not")
    points = clip.triangles.max() + 1
    with path.open("wb") as file:
        # Signature, version, points, first frame, frames a sample, samples.
        file.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, 0.0, 1.0, len(clip)))
        for frame in clip.frames():
            file.write(frame.positions.astype("<f4").tobytes())
    mesh = path.with_suffix(".obj")
    write_obj(bodies(clip, clip[0])[:1], mesh)  # a cache moves one mesh
    return [path, mesh]
