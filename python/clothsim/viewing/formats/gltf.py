"""Binary glTF 2.0: every frame a morph target, played by an animation of their weights.

Importers play morph targets: Blender as shape keys, three.js and Babylon.js as they are. One mesh
per frame would need animated visibility of nodes, a glTF extension that few programs read.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...base.build import build_config
from ..exports import Clip
from ..raster import CLOTH_FRONT, SPHERE
from .meshes import obstacle_mesh

FLOAT = 5126
UNSIGNED = 5125
VERTICES = 34962
INDICES = 34963
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
# Radians by which the normals of the first frame are off. With the normals of the triangles, as on
# a flat sheet, Blender shades flat in all frames. Its limit is 4.5e-4. At twice, no change is
# visible either.
TILT = 2e-3


def linear_light_of_color(color: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Return an sRGB colour in linear light, as materials have it."""
    red, green, blue = np.where(
        color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4
    ).tolist()
    return red, green, blue


MATERIALS = {
    "cloth": (linear_light_of_color(CLOTH_FRONT), 0.9),
    "sphere": (linear_light_of_color(SPHERE), 0.5),
}
"""Name -> colour and roughness."""


def write(clip: Clip, path: Path) -> list[Path]:
    file = _File()
    times = file.add_accessor(clip.times, bounds=True)
    nodes = [_add_cloth(file, clip, times)]
    nodes += [_add_obstacle(file, clip, times, k) for k in range(len(clip.spheres))]
    file.write(path, nodes)
    return [path]


class _File:
    """The JSON and the binary chunk of a .glb file while they grow."""

    def __init__(self) -> None:
        materials = [
            {
                "name": name,
                "doubleSided": name == "cloth",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*color, 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": rough,
                },
            }
            for name, (color, rough) in MATERIALS.items()
        ]
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"clothsim {build_config()['version']}"},
            "scene": 0,
            **{name: [] for name in ("bufferViews", "accessors", "meshes", "nodes")},
            "materials": materials,
            "animations": [{"name": "run", "samplers": [], "channels": []}],
        }
        self._parts: list[bytes] = []
        self._length = 0

    def add_entry(self, name: str, entry: dict[str, Any]) -> int:
        self.json[name].append(entry)
        return len(self.json[name]) - 1

    def add_accessor(
        self, values: npt.NDArray[Any], target: int | None = None, bounds: bool = False
    ) -> int:
        """Add an accessor of float32, or of uint32 if `values` are integers; return its number."""
        is_integer = values.dtype.kind == "i"
        data = np.ascontiguousarray(values, "<u4" if is_integer else "<f4")
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": data.nbytes}
        self._parts.append(data.tobytes())
        self._length += data.nbytes
        entry: dict[str, Any] = {
            "bufferView": self.add_entry(
                "bufferViews", view | ({} if target is None else {"target": target})
            ),
            "componentType": UNSIGNED if is_integer else FLOAT,
            "count": len(data),
            "type": KINDS[1 if data.ndim == 1 else data.shape[1]],
        }
        if bounds:
            entry |= {
                "min": np.atleast_1d(data.min(axis=0)).tolist(),
                "max": np.atleast_1d(data.max(axis=0)).tolist(),
            }
        return self.add_entry("accessors", entry)

    def add_mesh(
        self,
        name: str,
        positions: Any,
        normals: Any,
        corners: Any,
        uv: Any = None,
        targets: Any = None,
    ) -> int:
        attributes = {
            "POSITION": self.add_accessor(positions, VERTICES, True),
            "NORMAL": self.add_accessor(normals, VERTICES),
        }
        if uv is not None:
            attributes["TEXCOORD_0"] = self.add_accessor(uv, VERTICES)
        indices = self.add_accessor(corners.ravel(), INDICES)
        primitive = {
            "attributes": attributes,
            "indices": indices,
            "material": list(MATERIALS).index(name),
        }
        if targets is None:
            return self.add_entry("meshes", {"name": name, "primitives": [primitive]})
        primitive["targets"] = targets
        return self.add_entry(
            "meshes", {"name": name, "primitives": [primitive], "weights": [0.0] * len(targets)}
        )

    def add_animation(self, node: int, path: str, times: int, values: npt.NDArray[Any]) -> None:
        animation = self.json["animations"][0]
        animation["samplers"].append(
            {"input": times, "output": self.add_accessor(values), "interpolation": "LINEAR"}
        )
        sampler = len(animation["samplers"]) - 1
        animation["channels"].append({"sampler": sampler, "target": {"node": node, "path": path}})

    def write(self, path: Path, nodes: list[int]) -> None:
        self.json["scenes"] = [{"nodes": nodes}]
        if not self.json["animations"][0]["channels"]:
            del self.json["animations"]
        self.json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        with path.open("wb") as file:
            file.write(struct.pack("<III", 0x46546C67, 2, 28 + len(text) + self._length))
            file.write(struct.pack("<II", len(text), 0x4E4F534A) + text)
            file.write(struct.pack("<II", self._length, 0x004E4942))
            file.writelines(self._parts)


def _add_cloth(file: _File, clip: Clip, times: int) -> int:
    """Return the mesh of the first frame. Other frames are added as differences, one at a time."""
    targets: list[dict[str, int]] = []
    for frame in clip.make_frames():
        positions = frame.positions
        normals = clip.point_normals(frame.positions)
        if frame.number == 0:
            tilted = normals + TILT * np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=-1)])
            first = positions, tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)
            continue
        displacements = file.add_accessor(positions - first[0], VERTICES, True)
        targets.append(
            {"POSITION": displacements, "NORMAL": file.add_accessor(normals - first[1], VERTICES)}
        )
    # The origin of textures is their upper left corner. glTF has no empty list of targets.
    mesh = file.add_mesh(
        "cloth", *first, clip.triangles, clip.uv * [1, -1] + [0, 1], targets or None
    )
    node = file.add_entry("nodes", {"name": "cloth", "mesh": mesh})
    if targets:
        file.add_animation(node, "weights", times, np.eye(len(clip), len(targets), -1).ravel())
    return node


def _add_obstacle(file: _File, clip: Clip, times: int, k: int) -> int:
    vertices, corners, normals, _ = obstacle_mesh(clip, k)
    mesh = file.add_mesh("sphere", vertices, normals, corners)
    centers = np.array([clip.sphere_centers(n)[k] for n in range(len(clip))])
    node = file.add_entry(
        "nodes", {"name": clip.obstacle_name(k), "mesh": mesh, "translation": centers[0].tolist()}
    )
    if np.ptp(centers, axis=0).any():
        file.add_animation(node, "translation", times, centers)
    return node
