"""One file per frame, numbered from 1: Wavefront OBJ (text) and PLY (binary)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..clip import Clip
from .ball import Body, bodies


def numbered(path: Path, number: int) -> Path:
    """`path` with the number of the frame (from 1) before the suffix."""
    return path.with_name(f"{path.stem}_{number + 1:04d}{path.suffix}")


def write(clip: Clip, path: Path) -> list[Path]:
    """OBJ has one file per frame. PLY has no objects, so it has one file per frame and body."""
    files = []
    for frame in clip.frames():
        meshes = bodies(clip, frame)
        if path.suffix.lower() == ".obj":
            files.append(numbered(path, frame.number))
            write_obj(meshes, files[-1])
            continue
        for body in meshes:
            file = path if body is meshes[0] else path.with_name(f"{path.stem}_{body.name}{path.suffix}")
            files.append(numbered(file, frame.number))
            write_ply(body, files[-1])
    return files


def write_obj(meshes: Sequence[Body], path: Path) -> None:
    """Positions with 9 digits, which keep all of a float32, texture coordinates and normals."""
    lines, first = ["# clothsim, metres\n"], 1
    for body in meshes:
        corners = np.repeat(body.corners.ravel() + first, 3)
        lines += [
            f"o {body.name}\n",
            _lines("v %.9g %.9g %.9g\n", body.positions),
            _lines("vt %.9g %.9g\n", body.uv),
            _lines("vn %.6g %.6g %.6g\n", body.normals),
            _lines("f %d/%d/%d %d/%d/%d %d/%d/%d\n", corners.reshape(-1, 9)),
        ]
        first += len(body.positions)  # OBJ counts through all objects
    path.write_text("".join(lines), encoding="ascii", newline="\n")


def _lines(form: str, values: np.ndarray) -> str:
    return (form * len(values)) % tuple(values.ravel().tolist())


def write_ply(body: Body, path: Path) -> None:
    """Binary, little-endian, float32; texture coordinates under the names that Blender reads."""
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    vertices = np.hstack([body.positions, body.normals, body.uv])
    faces = np.empty(len(body.corners), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, body.corners
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
