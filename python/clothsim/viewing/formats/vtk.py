"""For VTK and ParaView: XML PolyData with a .pvd index, and VTKHDF, both over time."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ...base.extras import needed
from ..clip import Clip, Frame
from .ball import Body, bodies
from .sequences import numbered

_TYPES = {"f4": "Float32", "f8": "Float64", "i8": "Int64"}


def write(clip: Clip, path: Path) -> list[Path]:
    if path.suffix.lower() == ".vtkhdf":
        return _write_hdf(clip, path)
    return _write_series(clip, path)


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


# A .pvd index and one .vtp file a frame, and for each sphere ----------------------------------------


def _write_series(clip: Clip, path: Path) -> list[Path]:
    index = path.with_suffix(".pvd")
    entries, files = [], []
    for frame in clip.frames():
        for part, body in enumerate(bodies(clip, frame)):
            name = f"{path.stem}_{body.name}" if part else path.stem
            data = {"Normals": body.normals.astype("<f4")} if part else _point_data(clip, frame, body)
            file = numbered(path.with_name(name + ".vtp"), frame.number)
            file.write_bytes(_vtp(body.positions, body.corners, data))
            files.append(file)
            entries.append(f'    <DataSet timestep="{frame.time!r}" part="{part}" file={quoteattr(file.name)}/>')
    index.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "\n".join(entries)
        + "\n  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    return [index, *files]


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


# One VTKHDF file, version 2.0, of type PolyData with steps ------------------------------------------


def _write_hdf(clip: Clip, path: Path) -> list[Path]:
    h5py = needed("h5py", "export to .vtkhdf", "export")
    image = io.BytesIO()  # a file that HDF5 cannot write, as on a full disk, would end the process with a fault later
    with h5py.File(image, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = (2, 0)
        root.attrs["Type"] = np.bytes_("PolyData")
        for frame in clip.frames():
            meshes = bodies(clip, frame)
            if frame.number == 0:
                _topology(root, meshes, len(clip))
            for name, values in _hdf_arrays(clip, frame, meshes).items():
                _store(root, name, values, frame.number, len(clip))
        _steps(root, clip)
    path.write_bytes(image.getbuffer())
    return [path]


def _hdf_arrays(clip: Clip, frame: Frame, meshes: list[Body]) -> dict[str, np.ndarray]:
    """Points of all bodies with their data, the cloth first.

    "body" is 0 for the cloth and k + 1 for sphere k, whose points have its velocity and no depth.
    """
    cloth, *balls = meshes
    data = _point_data(clip, frame, cloth)
    more = zip(balls, clip.sphere_velocities(frame.number))
    parts = [data | {"body": np.zeros(len(cloth.positions), "<i4")}]
    for k, (ball, velocity) in enumerate(more, 1):
        parts.append(
            {
                "velocity": np.broadcast_to(velocity, ball.positions.shape),
                "depth": np.zeros(len(ball.positions)),
                "Normals": ball.normals,
                "TCoords": ball.uv,
                "body": np.full(len(ball.positions), k, "<i4"),
            }
        )
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    arrays = {f"PointData/{name}": values.astype(parts[0][name].dtype) for name, values in joined.items()}
    return {"Points": np.concatenate([body.positions for body in meshes]).astype("<f8"), **arrays}


def _store(root: Any, name: str, values: np.ndarray, number: int, frames: int) -> None:
    """Append the values of a frame as one chunk."""
    if name not in root:
        shape = (frames * len(values), *values.shape[1:])
        root.create_dataset(name, shape, values.dtype, chunks=values.shape)
    root[name][number * len(values) : (number + 1) * len(values)] = values


def _topology(root: Any, meshes: list[Body], frames: int) -> None:
    """Triangles, once for all frames. The format requires the other kinds of cells, which are empty."""
    sizes = [len(body.positions) for body in meshes]
    first = np.cumsum([0, *sizes[:-1]])
    corners = np.concatenate([body.corners + start for body, start in zip(meshes, first)])
    root["NumberOfPoints"] = np.full(frames, sum(sizes), "<i8")
    for kind in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = corners if kind == "Polygons" else corners[:0]
        root[f"{kind}/NumberOfCells"] = np.full(frames, len(cells), "<i8")
        root[f"{kind}/NumberOfConnectivityIds"] = np.full(frames, cells.size, "<i8")
        root[f"{kind}/Connectivity"] = cells.ravel().astype("<i8")
        root[f"{kind}/Offsets"] = np.arange(0, 3 * len(cells) + 3, 3, dtype="<i8")


def _steps(root: Any, clip: Clip) -> None:
    """Offsets of the arrays of every frame."""
    steps = root.create_group("Steps")
    frames = np.arange(len(clip), dtype="<i8")
    points = frames * root["NumberOfPoints"][0]
    steps.attrs["NSteps"] = len(clip)
    steps["Values"] = clip.times
    steps["PartOffsets"] = frames
    steps["NumberOfParts"] = np.ones(len(clip), "<i8")
    steps["PointOffsets"] = points
    # One column for each kind of cells; all frames share the topology.
    steps["CellOffsets"] = np.zeros((len(clip), 4), "<i8")
    steps["ConnectivityIdOffsets"] = np.zeros((len(clip), 4), "<i8")
    for name in root["PointData"]:
        steps[f"PointDataOffsets/{name}"] = points
