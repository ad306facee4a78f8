"""VTK and ParaView: a .pvd index and XML PolyData, one .vtp file a frame, for the cloth and for each sphere."""

from __future__ import annotations

import struct
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ..clip import Clip, Frame
from .ball import Body, bodies
from .sequences import numbered

_TYPES = {"f4": "Float32", "f8": "Float64", "i8": "Int64"}


def _point_data(clip: Clip, frame: Frame, body: Body) -> dict[str, np.ndarray]:
    """Data of every mass point; its depth is below the nearest sphere's true radius [m]."""
    depth = np.zeros(len(body.positions))
    for sphere, center in zip(clip.spheres, frame.centers):
        distance = np.linalg.norm(body.positions - center, axis=-1)
        depth = np.maximum(depth, sphere.radius - distance)
    return {
        "velocity": frame.velocities.astype("<f4"),
        "depth": depth.astype("<f4"),
        "Normals": body.normals.astype("<f4"),
        "TCoords": body.uv.astype("<f4"),
    }


def write(clip: Clip, path: Path) -> list[Path]:
    entries, files = [], []
    for frame in clip.frames():
        for part, body in enumerate(bodies(clip, frame)):
            name = f"{path.stem}_{body.name}" if part else path.stem
            data = {"Normals": body.normals.astype("<f4")} if part else _point_data(clip, frame, body)
            file = numbered(path.with_name(name + ".vtp"), frame.number)
            file.write_bytes(_vtp(body.positions, body.corners, data))
            files.append(file)
            entries.append(f'    <DataSet timestep="{frame.time!r}" part="{part}" file={quoteattr(file.name)}/>')
    path.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(entries)
        + "\n  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    return [path, *files]


def _vtp(positions: np.ndarray, corners: np.ndarray, data: dict[str, np.ndarray]) -> bytes:
    """A PolyData file whose arrays are raw bytes after the XML, each after its length."""
    raw: list[bytes] = []

    def array(name: str, values: np.ndarray) -> str:
        offset = sum(map(len, raw))
        values = np.ascontiguousarray(values)
        raw.append(struct.pack("<Q", values.nbytes) + values.tobytes())
        components = values.shape[1] if values.ndim == 2 else 1
        return (
            f'<DataArray type="{_TYPES[values.dtype.str[1:]]}" Name="{name}" '
            f'NumberOfComponents="{components}" format="appended" offset="{offset}"/>\n'
        )

    texture = ' TCoords="TCoords"' if "TCoords" in data else ""
    point_data = "".join(array(name, values) for name, values in data.items())
    points = array("Points", positions.astype("<f8"))
    polys = array("connectivity", corners.ravel().astype("<i8"))
    polys += array("offsets", np.arange(3, 3 * len(corners) + 3, 3, dtype="<i8"))
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">\n<PolyData>\n'
        f'<Piece NumberOfPoints="{len(positions)}" NumberOfPolys="{len(corners)}">\n'
        f'<PointData Normals="Normals"{texture}>\n{point_data}</PointData>\n'
        f"<Points>\n{points}</Points>\n<Polys>\n{polys}</Polys>\n</Piece>\n</PolyData>\n"
        '<AppendedData encoding="raw">\n_'
    )
    return head.encode() + b"".join(raw) + b"\n</AppendedData>\n</VTKFile>\n"
