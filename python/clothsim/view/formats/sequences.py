"""One file a frame, numbered from 1: Wavefront OBJ (text) and PLY (binary)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..clip import Clip, Frame


def numbered(path: Path, number: int) -> Path:
    """`path` with the number of the frame, from 1, before its suffix."""
    return path.with_name(f"{path.stem}_{number + 1:04d}{path.suffix}")


def write(clip: Clip, path: Path) -> list[Path]:
    one = write_obj if path.suffix.lower() == ".obj" else write_ply
    return write_each(clip, path, one)


def write_each(clip: Clip, path: Path, one: Callable[[Clip, Frame, Path], None]) -> list[Path]:
    """The files that `one` writes of the frames."""
    files = []
    for frame in clip.frames():
        files.append(numbered(path, frame.number))
        one(clip, frame, files[-1])
    return files


def write_obj(clip: Clip, frame: Frame, path: Path) -> None:
    """Positions with 9 digits, which is all of a float32, texture coordinates, normals."""
    normals = clip.normals(frame.positions)
    corners = np.repeat(clip.triangles.ravel() + 1, 3)
    lines = [
        "# clothsim, metres\no cloth\n",
        _lines("v %.9g %.9g %.9g\n", frame.positions),
        _lines("vt %.9g %.9g\n", clip.uv),
        _lines("vn %.6g %.6g %.6g\n", normals),
        _lines("f %d/%d/%d %d/%d/%d %d/%d/%d\n", corners.reshape(-1, 9)),
    ]
    path.write_text("".join(lines), encoding="ascii", newline="\n")


def _lines(form: str, values: np.ndarray) -> str:
    return (form * len(values)) % tuple(values.ravel().tolist())


def write_ply(clip: Clip, frame: Frame, path: Path) -> None:
    """Binary, little-endian, float32; texture coordinates under the names that Blender reads."""
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    vertices = np.hstack([frame.positions, clip.normals(frame.positions), clip.uv])
    faces = np.empty(len(clip.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, clip.triangles
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment clothsim, metres",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in names),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        file.write(vertices.astype("<f4").tobytes())
        file.write(faces.tobytes())
