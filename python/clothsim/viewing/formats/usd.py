"""OpenUSD: a mesh whose points have time samples, and a mesh that moves for each sphere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...base.build import build_config
from ..exports import Clip
from .gltf import MATERIALS
from .meshes import obstacle_mesh

# Time codes a second where frames stand at their own times; codes need not be whole.
CODES_PER_SECOND = 60.0
SAME_CODE = 1e-6  # a code nearer to a whole one is that one


def write(clip: Clip, path: Path) -> list[Path]:
    from pxr import Gf, Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateNew(str(path))
    rate = clip.rate or CODES_PER_SECOND
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Z" if clip.z_up else "Y")
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    codes = (clip.start + clip.times) * rate
    codes = np.where(np.abs(codes - codes.round()) < SAME_CODE, codes.round(), codes)
    stage.SetStartTimeCode(codes[0])
    stage.SetEndTimeCode(codes[-1])
    stage.SetMetadata("comment", f"clothsim {build_config()['version']}")
    root = UsdGeom.Xform.Define(stage, "/run").GetPrim()
    stage.SetDefaultPrim(root)
    root.SetCustomDataByKey("scene", json.dumps(clip.scene.to_dict()))
    mesh = _add_cloth(stage, clip)
    moves = [_add_obstacle(stage, clip, k) for k in range(len(clip.spheres))]
    for frame in clip.make_frames():
        code = Usd.TimeCode(codes[frame.number])
        extent = np.stack([frame.positions.min(axis=0), frame.positions.max(axis=0)])
        for attribute, values in (
            (mesh.GetPointsAttr(), frame.positions),
            (mesh.GetNormalsAttr(), clip.point_normals(frame.positions)),
            (mesh.GetVelocitiesAttr(), frame.velocities),
            (mesh.GetExtentAttr(), extent),
        ):
            attribute.Set(Vt.Vec3fArray.FromNumpy(values.astype(np.float32)), code)
        for move, sphere, center in zip(moves, clip.spheres, frame.centers):
            if sphere.motion is not None:
                move.Set(Gf.Vec3d(*center.tolist()), code)
    stage.GetRootLayer().Save()
    return [path]


def _add_mesh(stage: Any, name: str, corners: Any, material: str) -> Any:
    """Return a mesh of triangles with a normal at each vertex, so that it appears smooth."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, f"/run/{name}")
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(corners), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    _set_color_of_prim(stage, mesh, material)
    return mesh


def _add_cloth(stage: Any, clip: Clip) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    mesh = _add_mesh(stage, "cloth", clip.triangles, "cloth")
    mesh.CreateDoubleSidedAttr(True)
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    )
    coordinates.Set(Vt.Vec2fArray.FromNumpy(clip.uv.astype(np.float32)))
    return mesh


def _add_obstacle(stage: Any, clip: Clip, k: int) -> Any:
    """Return the translation of a sphere's mesh, at the sphere's place in the first frame.
    Importers tessellate UsdGeom.Sphere coarsely, each in its own way.
    """
    from pxr import Gf, Vt

    vertices, corners, normals, _ = obstacle_mesh(clip, k)
    mesh = _add_mesh(stage, clip.obstacle_name(k), corners, "sphere")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices.astype(np.float32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    mesh.CreateExtentAttr(
        [Gf.Vec3f(*end.tolist()) for end in (vertices.min(axis=0), vertices.max(axis=0))]
    )
    move = mesh.AddTranslateOp()
    move.Set(Gf.Vec3d(*clip.sphere_centers(0)[k].tolist()))
    return move


def _set_color_of_prim(stage: Any, prim: Any, name: str) -> None:
    """Give a prim a material for renderers, and a colour for viewers that read no materials."""
    from pxr import Gf, Sdf, UsdShade, Vt

    color, roughness = MATERIALS[name]
    prim.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*color)]))
    material = UsdShade.Material.Define(stage, f"/run/materials/{name}")
    shader = UsdShade.Shader.Define(stage, f"/run/materials/{name}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)
