"""Binary glTF 2.0: every frame a morph target, played by an animation of their weights.

Importers play morph targets: Blender as shape keys, three.js and Babylon.js as they are. One mesh per frame would need
animated visibility of nodes, a glTF extension that few programs read.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ...base import Floats
from ...machine.build import build_config
from ..clip import Clip
from ..raster import CLOTH_FRONT, SPHERE
from .ball import linear, unit_ball

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
CLOTH_COLOR, BALL_COLOR = linear(CLOTH_FRONT), linear(SPHERE)
# Radians by which the normals of the first frame are off. With the normals of the triangles, as on a flat sheet, Blender
# shades flat in all frames. Its limit is 4.5e-4. At twice, no change is visible either.
TILT = 2e-3


def write(clip: Clip, path: Path) -> list[Path]:
    file = _File()
    nodes = [_cloth(file, clip)]
    if clip.spheres:
        ball = _ball(file)
        nodes += [_sphere(file, clip, ball, k) for k in range(len(clip.spheres))]
    file.write(path, nodes)
    return [path]


class _File:
    """The JSON and the binary chunk of a .glb file while they grow."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"clothsim {build_config()['version']}"},
            "scene": 0,
            "bufferViews": [],
            "accessors": [],
            "meshes": [],
            "nodes": [],
            "materials": [_material("cloth", CLOTH_COLOR, 0.9), _material("sphere", BALL_COLOR, 0.5)],
            "animations": [{"name": "run", "samplers": [], "channels": []}],
        }
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, name: str, entry: dict[str, Any]) -> int:
        self.json[name].append(entry)
        return len(self.json[name]) - 1

    def accessor(self, values: Any, target: int | None = None, bounds: bool = False) -> int:
        """Add an accessor of float32 values, or of uint32 if `values` are integers; return its number."""
        whole = np.asarray(values).dtype.kind == "i"
        data = np.ascontiguousarray(values, "<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": data.nbytes}
        if target is not None:
            view["target"] = target
        self._parts.append(data.tobytes())
        self._length += data.nbytes
        entry: dict[str, Any] = {
            "bufferView": self.add("bufferViews", view),
            "componentType": _UNSIGNED if whole else _FLOAT,
            "count": len(data),
            "type": _KINDS[1 if data.ndim == 1 else data.shape[1]],
        }
        if bounds:
            entry["min"] = np.atleast_1d(data.min(axis=0)).tolist()
            entry["max"] = np.atleast_1d(data.max(axis=0)).tolist()
        return self.add("accessors", entry)

    def animate(self, node: int, path: str, times: int, values: Floats) -> None:
        animation = self.json["animations"][0]
        animation["samplers"].append({"input": times, "output": self.accessor(values), "interpolation": "LINEAR"})
        sampler = len(animation["samplers"]) - 1
        animation["channels"].append({"sampler": sampler, "target": {"node": node, "path": path}})

    def times(self, clip: Clip) -> int:
        """The accessor of the times of frames, one for all animations."""
        if not hasattr(self, "_times"):
            self._times = self.accessor(clip.times, bounds=True)
        return self._times

    def write(self, path: Path, nodes: list[int]) -> None:
        self.json["scenes"] = [{"nodes": nodes}]
        self.json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        with path.open("wb") as file:
            file.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + self._length))
            file.write(struct.pack("<II", len(text), 0x4E4F534A) + text)
            file.write(struct.pack("<II", self._length, 0x004E4942))
            file.writelines(self._parts)


def _material(name: str, color: tuple[float, float, float], roughness: float) -> dict[str, Any]:
    return {
        "name": name,
        "doubleSided": name == "cloth",
        "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness},
    }


def _cloth(file: _File, clip: Clip) -> int:
    """The mesh of the first frame. Other frames are added as differences, one at a time."""
    targets = []
    for frame in clip.frames():
        positions, normals = frame.positions, clip.normals(frame.positions)
        if frame.number == 0:
            axis = np.eye(3)[np.abs(normals).argmin(axis=-1)]
            tilted = normals + TILT * np.cross(normals, axis)
            first = positions, tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)
            continue
        targets.append(
            {
                "POSITION": file.accessor(positions - first[0], _VERTICES, bounds=True),
                "NORMAL": file.accessor(normals - first[1], _VERTICES),
            }
        )
    primitive: dict[str, Any] = {
        "attributes": {
            "POSITION": file.accessor(first[0], _VERTICES, bounds=True),
            "NORMAL": file.accessor(first[1], _VERTICES),
            # The origin of textures is their upper left corner.
            "TEXCOORD_0": file.accessor(clip.uv * [1, -1] + [0, 1], _VERTICES),
        },
        "indices": file.accessor(clip.triangles.ravel(), _INDICES),
        "material": 0,
        "targets": targets,
    }
    mesh = {"name": "cloth", "primitives": [primitive], "weights": [0.0] * len(targets)}
    node = file.add("nodes", {"name": "cloth", "mesh": file.add("meshes", mesh)})
    weights = np.eye(len(clip), len(targets), -1)
    file.animate(node, "weights", file.times(clip), weights.ravel())
    return node


def _ball(file: _File) -> int:
    vertices, corners = unit_ball()
    primitive = {
        "attributes": {
            "POSITION": file.accessor(vertices, _VERTICES, bounds=True),
            "NORMAL": file.accessor(vertices, _VERTICES),
        },
        "indices": file.accessor(corners.ravel(), _INDICES),
        "material": 1,
    }
    return file.add("meshes", {"name": "sphere", "primitives": [primitive]})


def _sphere(file: _File, clip: Clip, mesh: int, k: int) -> int:
    centers = np.array([clip.centers(n)[k] for n in range(len(clip))])
    node = file.add(
        "nodes",
        {"name": f"sphere_{k}", "mesh": mesh, "scale": [clip.spheres[k].radius] * 3, "translation": centers[0].tolist()},
    )
    if np.ptp(centers, axis=0).any():
        file.animate(node, "translation", file.times(clip), centers)
    return node
