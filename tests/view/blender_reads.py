"""Run by Blender's Python: imports exported files as docs/export.md says, and prints positions.

    python blender_reads.py FOLDER FRAME...

Prints JSON: positions in Blender's world (z up) by file and frame, and whether the .glb is shaded smooth.
"""

import json
import sys
from pathlib import Path

STILL = (".obj", ".ply")


def open_file(bpy, path):
    """The cloth of a file in an empty scene of 60 frames a second."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 60
    mesh = path.with_suffix(".obj") if path.suffix == ".pc2" else path
    read = {
        ".usdc": bpy.ops.wm.usd_import,
        ".glb": bpy.ops.import_scene.gltf,
        ".obj": bpy.ops.wm.obj_import,
        ".ply": bpy.ops.wm.ply_import,
    }[mesh.suffix]
    read(filepath=str(mesh), **({"forward_axis": "Y", "up_axis": "Z"} if mesh.suffix in STILL else {}))
    cloth = next(one for one in scene.objects if not one.name.startswith(("run", "sphere")))
    if path.suffix == ".pc2":
        modifier = cloth.modifiers.new("cache", "MESH_CACHE")
        modifier.cache_format, modifier.filepath = "PC2", str(path)
    return cloth


def vertices(bpy, thing):
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [list(evaluated.matrix_world @ vertex.co) for vertex in evaluated.to_mesh().vertices]


def main(folder, *frames):
    import bpy

    positions = {}
    for path in sorted(Path(folder).iterdir()):
        if path.name == "a.obj":  # the mesh of the cache
            continue
        cloth = open_file(bpy, path)
        still = path.suffix in STILL
        for frame in [int(path.stem.rpartition("_")[2]) - 1] if still else map(int, frames):
            if not still:
                bpy.context.scene.frame_set(frame)
            positions[f"{path.suffix} {frame}"] = vertices(bpy, cloth)
        if path.suffix == ".glb":
            positions["smooth"] = all(face.use_smooth for face in cloth.data.polygons)
    print("READ", json.dumps(positions))


if __name__ == "__main__":
    main(*sys.argv[1:])
