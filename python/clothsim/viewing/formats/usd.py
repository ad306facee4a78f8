"""OpenUSD: one mesh whose points have time samples, and a sphere prim for each sphere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...machine.build import build_config
from ..clip import Clip, Frame
from .gltf import BALL_COLOR, CLOTH_COLOR

# Time codes a second where frames stand at their own times; codes need not be whole.
_CODES_PER_SECOND = 60.0


def write(clip: Clip, path: Path) -> list[Path]:
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    rate = clip.fps or _CODES_PER_SECOND
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, clip.up)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(clip.times[-1] * rate)
    stage.SetMetadata("comment", f"clothsim {build_config()['version']}")
    root = UsdGeom.Xform.Define(stage, "/run")
    stage.SetDefaultPrim(root.GetPrim())
    root.GetPrim().SetCustomDataByKey("scene", json.dumps(clip.scene.to_dict()))

    mesh = _cloth(stage, clip)
    moves = [_sphere(stage, clip, k) for k in range(len(clip.spheres))]
    for frame in clip.frames():
        code = Usd.TimeCode(float(frame.number) if clip.fps else frame.time * rate)
        _set_points(mesh, clip, frame, code)
        for move, center in zip(moves, frame.centers):
            if move is not None:
                move.Set(Gf.Vec3d(*center.tolist()), code)
    stage.GetRootLayer().Save()
    return [path]


def _cloth(stage: Any, clip: Clip) -> Any:
    from pxr import Sdf, UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, "/run/cloth")
    corners = clip.triangles
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(corners), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    coordinates.Set(Vt.Vec2fArray.FromNumpy(clip.uv.astype(np.float32)))
    _paint(stage, mesh, "cloth", CLOTH_COLOR, 0.9)
    return mesh


def _paint(stage: Any, prim: Any, name: str, color: tuple[float, float, float], roughness: float) -> None:
    """A material for renderers, and the colour for viewers that read no materials."""
    from pxr import Gf, Sdf, UsdShade, Vt

    prim.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*color)]))
    material = UsdShade.Material.Define(stage, f"/run/materials/{name}")
    shader = UsdShade.Shader.Define(stage, f"/run/materials/{name}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


def _set_points(mesh: Any, clip: Clip, frame: Frame, code: Any) -> None:
    from pxr import Vt

    points = frame.positions.astype(np.float32)
    normals = clip.normals(frame.positions).astype(np.float32)
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), code)
    mesh.GetNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(normals), code)
    mesh.GetVelocitiesAttr().Set(Vt.Vec3fArray.FromNumpy(frame.velocities.astype(np.float32)), code)
    extent = np.stack([points.min(axis=0), points.max(axis=0)])
    mesh.GetExtentAttr().Set(Vt.Vec3fArray.FromNumpy(extent), code)


def _sphere(stage: Any, clip: Clip, k: int) -> Any:
    """The translation of a sphere's prim, which gets a sample a frame, or None where it rests."""
    from pxr import Gf, UsdGeom

    radius = clip.spheres[k].radius
    prim = UsdGeom.Sphere.Define(stage, f"/run/sphere_{k}")
    prim.CreateRadiusAttr(radius)
    prim.CreateExtentAttr([Gf.Vec3f(-radius), Gf.Vec3f(radius)])
    _paint(stage, prim, "sphere", BALL_COLOR, 0.5)
    move = prim.AddTranslateOp()
    if clip.spheres[k].motion is not None:
        return move
    move.Set(Gf.Vec3d(*clip.centers(0)[k].tolist()))
    return None
