"""Files of meshes: .obj (text), .ply (binary) and VTK's .pvd with .vtp, one file a frame; .pc2,
positions of all frames.
"""

from __future__ import annotations

import struct
from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from ...base import Floats
from ..exports import Clip, Frame

# Cells of a sphere, which is off the true one by at most 0.5 % of the radius.
AROUND = 48
FROM_POLE_TO_POLE = 24
PLANE_WIDTH = 3.0  # side of a plane's square, in longest sides of the box around the scene
VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i8": "Int64"}


class Body(NamedTuple):
    """A mesh of one frame: the cloth, a sphere, or a square of a plane."""

    name: str
    positions: Floats  # (points, 3) [m]
    corners: npt.NDArray[np.int64]  # (triangles, 3)
    normals: Floats
    uv: Floats  # texture coordinates, (points, 2)


@cache
def unit_ball_mesh() -> tuple[Floats, npt.NDArray[np.int64], Floats]:
    """Return the vertices, which are also the normals, triangles whose normals point outwards, and
    longitude and latitude, 0 to 1.
    """
    v, u = np.meshgrid(
        np.linspace(0, 1, FROM_POLE_TO_POLE + 1), np.linspace(0, 1, AROUND + 1), indexing="ij"
    )
    polar = np.pi * v
    around = 2 * np.pi * u
    vertices = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], -1
    )
    r, c = np.divmod(np.arange(FROM_POLE_TO_POLE * AROUND), AROUND)
    corner = r * (AROUND + 1) + c
    below = corner + AROUND + 1
    right = corner + 1
    upper = np.stack([corner, below, right], -1)[r > 0]  # at a pole a cell is one triangle
    lower = np.stack([right, below, below + 1], -1)[r < FROM_POLE_TO_POLE - 1]
    return (
        vertices.reshape(-1, 3),
        np.concatenate([upper, lower]),
        np.stack([u, 1 - v], -1).reshape(-1, 2),
    )


def obstacle_mesh(clip: Clip, k: int) -> tuple[Floats, npt.NDArray[np.int64], Floats, Floats]:
    """Return vertices from its centre, triangles, normals and texture coordinates of a sphere, or
    of a square of a plane.
    """
    if not np.isinf(clip.spheres[k].radius):
        vertices, corners, uv = unit_ball_mesh()
        return clip.spheres[k].radius * vertices, corners, vertices, uv
    low, high = clip.bounding_box
    normal = clip.plane_normal(k)
    middle = (low + high) / 2 - clip.sphere_centers(0)[k]
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    along *= PLANE_WIDTH / 2 * (high - low).max() / np.linalg.norm(along)
    sides = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    square = sides @ np.stack([along, np.cross(normal, along)])
    vertices = middle - (middle @ normal) * normal + square
    return vertices, np.array([[0, 1, 2], [0, 2, 3]]), np.tile(normal, (4, 1)), (sides + 1) / 2


def frame_bodies(clip: Clip, frame: Frame) -> list[Body]:
    """Return the cloth, then the spheres at their places in that frame."""
    meshes = [
        Body("cloth", frame.positions, clip.triangles, clip.point_normals(frame.positions), clip.uv)
    ]
    for k, center in enumerate(frame.centers):
        vertices, corners, normals, uv = obstacle_mesh(clip, k)
        meshes.append(Body(clip.obstacle_name(k), center + vertices, corners, normals, uv))
    return meshes


def write(clip: Clip, path: Path) -> list[Path]:
    """Write files numbered from 1: .obj, one for each frame, with the bodies as its objects; else
    one for each frame and body.
    """
    suffix = path.suffix.lower()
    if suffix == ".pc2":
        return _write_pc2(clip, path)
    files = []
    entries = []
    for frame in clip.make_frames():
        meshes = frame_bodies(clip, frame)
        for part, body in enumerate(meshes[:1] if suffix == ".obj" else meshes):
            name = f"{path.stem}_{body.name}" if part else path.stem
            files.append(
                path.with_name(
                    f"{name}_{frame.number + 1:04d}{'.vtp' if suffix == '.pvd' else path.suffix}"
                )
            )
            if suffix == ".obj":
                data = _encode_obj(meshes)
            elif suffix == ".ply":
                data = _encode_ply(body)
            else:
                data = _encode_vtp(clip, frame, body)
            files[-1].write_bytes(data)
            entries.append(
                f'<DataSet timestep="{clip.start + frame.time!r}" part="{part}" '
                f"file={quoteattr(files[-1].name)}/>\n"
            )
    if suffix != ".pvd":
        return files
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    path.write_text(head + "".join(entries) + "</Collection>\n</VTKFile>\n", encoding="utf-8")
    return [path, *files]


def _write_pc2(clip: Clip, path: Path) -> list[Path]:
    """Write the cache, and the mesh that it moves."""
    if clip.fps is None and len(clip) > 1:
        raise ValueError(
            "fps must be a number for .pc2, which holds frames at equal distances: those of "
            "the run are not"
        )
    with path.open("wb") as file:
        # Signature, version, points, first frame, frames a sample, samples.
        file.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(clip.uv), 0.0, 1.0, len(clip)))
        for frame in clip.make_frames():
            file.write(frame.positions.astype("<f4").tobytes())
    mesh = path.with_suffix(".obj")
    mesh.write_bytes(_encode_obj(frame_bodies(clip, clip[0])[:1]))
    return [path, mesh]


def _encode_obj(meshes: Sequence[Body]) -> bytes:
    """Return a text with 9 digits of a position, which keep all of a float32."""
    lines = ["# clothsim, metres\n"]
    first = 1
    for body in meshes:
        corners = np.repeat(body.corners.ravel() + first, 3).reshape(-1, 9)
        lines.append(f"o {body.name}\n")
        for form, values in (
            ("v %.9g %.9g %.9g\n", body.positions),
            ("vt %.9g %.9g\n", body.uv),
            ("vn %.6g %.6g %.6g\n", body.normals),
            ("f %d/%d/%d %d/%d/%d %d/%d/%d\n", corners),
        ):
            lines.append((form * len(values)) % tuple(values.ravel().tolist()))
        first += len(body.positions)  # OBJ counts through all objects
    return "".join(lines).encode()


def _encode_ply(body: Body) -> bytes:
    """Return binary data, little-endian, float32; texture coordinates have the names that Blender
    reads.
    """
    vertices = np.hstack([body.positions, body.normals, body.uv]).astype("<f4")
    faces = np.empty(len(body.corners), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = body.corners
    names = "".join(
        f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    )
    head = (
        "ply\nformat binary_little_endian 1.0\ncomment clothsim, metres\nelement vertex "
        f"{len(vertices)}\n{names}"
    )
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    return head.encode() + vertices.tobytes() + faces.tobytes()


def _encode_vtp(clip: Clip, frame: Frame, body: Body) -> bytes:
    """Return PolyData as XML; mass points have velocities, and depths below the
    nearest true surface [m].
    """

    def encode_array(name: str, values: npt.NDArray[np.generic]) -> str:
        """Return values as binary data after their length, both as base64."""
        text = b64encode(struct.pack("<Q", values.nbytes) + values.tobytes()).decode()
        kind = VTK_TYPES[values.dtype.str[1:]]
        components = values.shape[1] if values.ndim == 2 else 1
        head = (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" '
            'format="binary">'
        )
        return f"{head}{text}</DataArray>\n"

    data = {"Normals": body.normals, "TCoords": body.uv}
    if body.name == "cloth":
        distances = (
            clip.depth_below_obstacle(k, body.positions - center)
            for k, center in enumerate(frame.centers)
        )
        depth = np.max([np.zeros(len(body.positions)), *distances], axis=0)
        data |= {"velocity": frame.velocities, "depth": depth}
    point_data = "".join(encode_array(name, values.astype("<f4")) for name, values in data.items())
    polys = encode_array("connectivity", body.corners.ravel().astype("<i8"))
    polys += encode_array("offsets", np.arange(3, 3 * len(body.corners) + 3, 3, dtype="<i8"))
    return (
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64">\n'
        f'<PolyData>\n<Piece NumberOfPoints="{len(body.positions)}" '
        f'NumberOfPolys="{len(body.corners)}">\n'
        f'<PointData Normals="Normals" TCoords="TCoords">\n{point_data}</PointData>\n'
        f"<Points>\n{encode_array('Points', body.positions.astype('<f8'))}</Points>\n"
        f"<Polys>\n{polys}</Polys>\n"
        "</Piece>\n</PolyData>\n</VTKFile>\n"
    ).encode()
