"""Each export format, read back by a reader that shares no code with the writer."""

import struct
from xml.etree import ElementTree

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.exports import export
from clothsim.viewing.formats.gltf import linear
from clothsim.viewing.raster import CLOTH_FRONT, SPHERE

FPS = 50
SINGLE = 2.0**-23  # relative rounding of float32, and a little more


@pytest.fixture(scope="module")
def run():
    cloth = cs.Cloth(shape=(5, 7), size=(0.8, 1.2), mass=1.0, stiffness=100.0, damping=0.1)
    moving = cs.Sphere((0.5, -0.3, 0.4), 0.2, response="ray", offset="edge", motion=cs.Linear((1.0, 0.5, -0.25)))
    resting = cs.Sphere((0.2, -0.06, 0.2), 0.1, response="ray", offset="edge")  # around a mass point at first
    return cs.simulate(cs.Scene(cloth, [moving, resting]), 0.2, dt=1e-3, every=0.02)


def points(run, k, z_up=False, of=None):
    x = (run.x if of is None else of)[k].reshape(-1, 3)
    return np.stack([x[:, 0], -x[:, 2], x[:, 1]], -1) if z_up else x


def normals(x, shape):
    """Sum over triangles of the cross products at each corner, one by one."""
    total = np.zeros_like(x)
    for a, b, c in cs.triangles(shape):
        total[[a, b, c]] += np.cross(x[b] - x[a], x[c] - x[a])
    return total / np.linalg.norm(total, axis=-1, keepdims=True)


def texture(shape):
    return np.array([(c / (shape[1] - 1), 1 - r / (shape[0] - 1)) for r in range(shape[0]) for c in range(shape[1])])


def close(found, expected, tolerance=SINGLE):
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=2 * tolerance)


@pytest.mark.parametrize("z_up", [False, True])
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_usd(run, tmp_path, suffix, z_up):
    pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    from pxr import Usd, UsdGeom, UsdShade

    (path,) = export(run, tmp_path / f"a{suffix}", FPS, z_up)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == ("Z" if z_up else "Y")
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == FPS
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 10)
    assert stage.GetDefaultPrim().GetPath() == "/run"
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth"))
    assert mesh.GetPointsAttr().GetTimeSamples() == list(range(11))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    assert (corners == cs.triangles((5, 7))).all() and set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    assert mesh.GetOrientationAttr().Get() == "rightHanded"
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    for name, material in (("cloth", "cloth"), ("sphere_0", "sphere"), ("sphere_1", "sphere")):
        bound = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(f"/run/{name}"))
        assert bound.ComputeBoundMaterial()[0].GetPath() == f"/run/materials/{material}"
    st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    assert st.GetInterpolation() == mesh.GetNormalsInterpolation() == "vertex"
    close(np.array(st.Get()), texture((5, 7)))
    grey = UsdGeom.Mesh(stage.GetPrimAtPath("/run/sphere_0")).GetDisplayColorAttr().Get()[0]
    close(np.array(grey), linear(SPHERE), 1e-7)
    for k in range(11):
        x = points(run, k, z_up)
        close(np.array(mesh.GetPointsAttr().Get(k)), x)
        close(np.array(mesh.GetNormalsAttr().Get(k)), normals(x, (5, 7)))
        v = points(run, k, z_up, run.v)
        close(np.array(mesh.GetVelocitiesAttr().Get(k)), v)
        close(np.array(mesh.GetExtentAttr().Get(k)), [x.min(axis=0), x.max(axis=0)])
        for j in range(2):
            ball = UsdGeom.Mesh(stage.GetPrimAtPath(f"/run/sphere_{j}"))
            assert ball.GetNormalsInterpolation() == "vertex" and ball.GetSubdivisionSchemeAttr().Get() == "none"
            vertices, directions = (np.array(of.Get(), float) for of in (ball.GetPointsAttr(), ball.GetNormalsAttr()))
            vertices += ball.ComputeLocalToWorldTransform(k).ExtractTranslation()
            faces = np.array(ball.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
            check_ball(run, j, k, vertices, faces, directions, z_up)


def test_usd_with_stored_frames_keeps_their_times(run, tmp_path):
    pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    from pxr import Usd, UsdGeom

    (path,) = export(run, tmp_path / "a.usdc")
    stage = Usd.Stage.Open(str(path))
    codes = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth")).GetPointsAttr().GetTimeSamples()
    np.testing.assert_allclose(np.array(codes) / stage.GetTimeCodesPerSecond(), run.t, rtol=1e-12)
    assert stage.GetEndTimeCode() == codes[-1]


def test_glb_by_pygltflib(run, tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    (path,) = export(run, tmp_path / "a.glb", FPS)
    file = pygltflib.GLTF2().load(str(path))
    blob = file.binary_blob()
    assert len(blob) == file.buffers[0].byteLength
    kinds = {5126: "<f4", 5125: "<u4"}
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}

    def values(number):
        accessor = file.accessors[number]
        start = file.bufferViews[accessor.bufferView].byteOffset
        count = accessor.count * width[accessor.type]
        data = np.frombuffer(blob, kinds[accessor.componentType], count, start)
        data = data.reshape(accessor.count, -1)
        if accessor.min:
            assert (data.min(axis=0) == accessor.min).all()
            assert (data.max(axis=0) == accessor.max).all()
        return data

    cloth, moving, resting = (file.nodes[n] for n in file.scenes[0].nodes)
    (primitive,) = file.meshes[cloth.mesh].primitives
    first = {name: values(getattr(primitive.attributes, name)) for name in ("POSITION", "NORMAL")}
    assert (values(primitive.indices).reshape(-1, 3) == cs.triangles((5, 7))).all()
    close(values(primitive.attributes.TEXCOORD_0), [0, 1] + texture((5, 7)) * [1, -1])

    channels = {(c.target.node, c.target.path): file.animations[0].samplers[c.sampler] for c in file.animations[0].channels}
    assert set(channels) == {(0, "weights"), (1, "translation")}
    assert {s.interpolation for s in channels.values()} == {"LINEAR"}
    weights = channels[0, "weights"]
    close(values(weights.input)[:, 0], run.t)
    table = values(weights.output).reshape(len(run.t), len(primitive.targets))
    deltas = {name: np.array([values(target[name]) for target in primitive.targets]) for name in ("POSITION", "NORMAL")}
    for k in range(len(run.t)):
        x = points(run, k)
        shape = {n: first[n] + np.einsum("t,tpc->pc", table[k], deltas[n]) for n in deltas}
        close(shape["POSITION"], x, 2 * SINGLE)
        close(shape["NORMAL"], normals(x, (5, 7)), 3e-3 if k == 0 else 2 * SINGLE)
    # Blender shades a triangle flat in all frames where its corners have its own normal in the first one.
    a, b, c = np.moveaxis(first["POSITION"][cs.triangles((5, 7))].astype(float), 1, 0)
    own = np.cross(b - a, c - a)
    own /= np.linalg.norm(own, axis=-1, keepdims=True)
    assert ((own * first["NORMAL"][cs.triangles((5, 7))[:, 0]]).sum(-1) < 0.9999999).all()
    close(np.linalg.norm(first["NORMAL"], axis=-1), 1.0, 2 * SINGLE)
    drawn = [linear(CLOTH_FRONT), linear(SPHERE)]
    assert [m.pbrMetallicRoughness.baseColorFactor[:3] for m in file.materials] == [list(color) for color in drawn]
    # Half way between two frames importers show their mean.
    mean = first["POSITION"] + np.einsum("t,tpc->pc", table[3:5].mean(0), deltas["POSITION"])
    close(mean, (points(run, 3) + points(run, 4)) / 2, 2 * SINGLE)

    sphere = run.scene.spheres[0]
    close(values(channels[1, "translation"].output), sphere.center_at(run.t))
    for node, sphere in zip((moving, resting), run.scene.spheres):
        close(node.translation, sphere.center_at(0.0))
        close(node.scale, [sphere.radius] * 3)


@pytest.mark.parametrize("z_up", [False, True])
def test_a_point_cache_by_its_published_layout(run, tmp_path, z_up):
    pc2, mesh = export(run, tmp_path / "a.pc2", FPS, z_up)
    data = pc2.read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    assert struct.unpack_from("<iiffi", data, 12) == (1, 35, 0.0, 1.0, 11)
    x = np.frombuffer(data, "<f4", offset=32).reshape(11, 35, 3)
    for k in range(11):
        close(x[k], points(run, k, z_up))
    lines = [line.split() for line in mesh.read_text().splitlines()]
    close([[float(n) for n in line[1:]] for line in lines if line[0] == "v"], points(run, 0, z_up))
    corners = [[int(n.split("/")[0]) - 1 for n in line[1:]] for line in lines if line[0] == "f"]
    assert (np.array(corners) == cs.triangles((5, 7))).all()


def test_pc2_refuses_stored_frames_at_unequal_distances(run, tmp_path):
    uneven = cs.simulate(run.scene, 0.1, dt=1e-3, every=0.03)
    with pytest.raises(ValueError, match=r"fps must be a number for \.pc2"):
        export(uneven, tmp_path / "a.pc2")


def check_ball(run, j, k, vertices, faces, vertex_normals, z_up=False, tolerance=SINGLE):
    """A mesh of sphere j in frame k: on the sphere, closed, wound outwards, without a hole."""
    sphere = run.scene.spheres[j]
    x, y, z = sphere.center_at(run.t[k])
    center = np.array([x, -z, y] if z_up else [x, y, z])
    close(np.linalg.norm(vertices - center, axis=-1), sphere.radius, 8 * tolerance)
    close(vertex_normals, (vertices - center) / sphere.radius, 1e-5)
    a, b, c = (vertices[faces[:, n]] - center for n in range(3))
    volume = np.einsum("nk,nk->n", a, np.cross(b, c)) / 6
    assert (volume > 0).all() and volume.sum() == pytest.approx(4 / 3 * np.pi * sphere.radius**3, rel=0.01)


@pytest.mark.parametrize("z_up", [False, True])
def test_obj_sequence_by_meshio(run, tmp_path, z_up):
    meshio = pytest.importorskip("meshio")
    files = export(run, tmp_path / "a.obj", FPS, z_up)
    assert [file.name for file in files] == [f"a_{k:04d}.obj" for k in range(1, 12)]
    for k, file in enumerate(files):
        objects = [line for line in file.read_text().splitlines() if line.startswith("o ")]
        assert objects == ["o cloth", "o sphere_0", "o sphere_1"]
        mesh = meshio.read(file)
        x = points(run, k, z_up)
        close(mesh.points[:35], x, 1e-8)  # 9 digits
        faces = mesh.cells_dict["triangle"]
        assert (faces[:48] == cs.triangles((5, 7))).all()
        close(mesh.point_data["obj:vn"][:35], normals(x, (5, 7)), 1e-5)
        close(mesh.point_data["obj:vt"][:35], texture((5, 7)), 1e-8)
        each = (len(mesh.points) - 35) // 2
        for j in range(2):
            own = slice(35 + j * each, 35 + (j + 1) * each)
            of_ball = faces[(faces >= own.start).all(axis=1) & (faces < own.stop).all(axis=1)]
            vertices, directions = mesh.points[own], mesh.point_data["obj:vn"][own]
            check_ball(run, j, k, vertices, of_ball - own.start, directions, z_up, 1e-8)
        assert (mesh.point_data["obj:vt"] >= 0).all() and (mesh.point_data["obj:vt"] <= 1).all()


@pytest.mark.parametrize("z_up", [False, True])
def test_ply_sequence_by_meshio(run, tmp_path, z_up):
    meshio = pytest.importorskip("meshio")
    files = export(run, tmp_path / "a.ply", FPS, z_up)
    names = [f"{body}_{k:04d}.ply" for k in range(1, 12) for body in ("a", "a_sphere_0", "a_sphere_1")]
    assert [file.name for file in files] == names
    for k in range(11):
        cloth, *balls = (meshio.read(file) for file in files[3 * k : 3 * k + 3])
        x = points(run, k, z_up)
        close(cloth.points, x)
        assert (cloth.cells_dict["triangle"] == cs.triangles((5, 7))).all()
        close(np.stack([cloth.point_data[n] for n in ("nx", "ny", "nz")], -1), normals(x, (5, 7)))
        close(np.stack([cloth.point_data[n] for n in "st"], -1), texture((5, 7)))
        for j, ball in enumerate(balls):
            directions = np.stack([ball.point_data[n] for n in ("nx", "ny", "nz")], -1)
            check_ball(run, j, k, ball.points, ball.cells_dict["triangle"], directions, z_up)


def depth(run, k):
    x, t = points(run, k), run.t[k]
    below = [s.radius - np.linalg.norm(x - s.center_at(t), axis=-1) for s in run.scene.spheres]
    return np.maximum(np.max(below, axis=0), 0)


def check_polydata(run, k, mesh):
    """The cloth of a frame as VTK read it."""
    from vtk.util.numpy_support import vtk_to_numpy

    x = points(run, k)
    arrays = mesh.GetPointData()
    names = [arrays.GetArrayName(n) for n in range(arrays.GetNumberOfArrays())]
    data = {name: vtk_to_numpy(arrays.GetArray(name)) for name in names}
    assert (vtk_to_numpy(mesh.GetPoints().GetData()) == x).all()  # float64
    assert (vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3) == cs.triangles((5, 7))).all()
    close(data["velocity"], run.v[k].reshape(-1, 3))
    close(data["depth"], depth(run, k))
    close(data["Normals"], normals(x, (5, 7)))
    close(data["TCoords"], texture((5, 7)))


def test_some_point_is_inside_a_sphere(run):
    """So that depths in the files are not all 0."""
    assert depth(run, 0).max() == pytest.approx(0.04)


def test_pvd_with_vtp_by_vtk(run, tmp_path):
    vtk = pytest.importorskip("vtk", reason="needs vtk: make test-export")
    index, *files = export(run, tmp_path / "a.pvd", FPS)
    assert index == tmp_path / "a.pvd"
    entries = ElementTree.parse(index).getroot().findall("Collection/DataSet")
    assert [e.get("file") for e in entries] == [file.name for file in files]
    reader = vtk.vtkXMLPolyDataReader()
    for e in entries:
        reader.SetFileName(str(tmp_path / e.get("file")))
        reader.Update()
        k = round(float(e.get("timestep")) * FPS)
        assert float(e.get("timestep")) == k / FPS
        if e.get("part") == "0":
            check_polydata(run, k, reader.GetOutput())
            continue
        sphere = run.scene.spheres[int(e.get("part")) - 1]
        low, high = np.array(reader.GetOutput().GetBounds()).reshape(3, 2).T
        close(low, sphere.center_at(run.t[k]) - sphere.radius, 1e-12)
        close(high, sphere.center_at(run.t[k]) + sphere.radius, 1e-12)
    assert [e.get("part") for e in entries] == ["0", "1", "2"] * 11
