"""`Run.export`: each format, read back by a reader that shares no code with the writer, and the
frames that it writes.
"""

import struct
import warnings
from types import SimpleNamespace
from xml.etree import ElementTree

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.exports import FORMATS, Clip, export
from clothsim.viewing.formats.gltf import linear_light_of_color
from clothsim.viewing.raster import CLOTH_FRONT, SPHERE

FPS = 50
SINGLE = 2.0**-23  # relative rounding of float32, and a little more
TRIANGLES = cs.triangles((5, 7))


@pytest.fixture(scope="module")
def run():
    cloth = cs.Cloth(shape=(5, 7), size=(0.8, 1.2), mass=1.0, stiffness=100.0, damping=0.1)
    moving = cs.Sphere(
        (0.5, -0.3, 0.4), 0.2, response="ray", offset="edge", motion=cs.Linear((1.0, 0.5, -0.25))
    )
    resting = cs.Sphere(
        (0.2, -0.06, 0.2), 0.1, response="ray", offset="edge"
    )  # around a mass point at first
    return cs.simulate(cs.Scene(cloth, [moving, resting]), 0.2, dt=1e-3, every=0.02)


def turned(x, z_up):
    return np.stack([x[..., 0], -x[..., 2], x[..., 1]], -1) if z_up else x


def points(run, k, z_up=False):
    return turned(run.x[k].reshape(-1, 3), z_up)


def normals(x):
    """Return the sum over triangles of the cross products at each corner, one by one."""
    total = np.zeros_like(x)
    for a, b, c in TRIANGLES:
        total[[a, b, c]] += np.cross(x[b] - x[a], x[c] - x[a])
    return total / np.linalg.norm(total, axis=-1, keepdims=True)


TEXTURE = np.array(
    [(c / 6, 1 - r / 4) for r in range(5) for c in range(7)]
)  # from above upright and not mirrored


def close(found, expected, tolerance=SINGLE):
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=2 * tolerance)


def read_usd(files, k):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(files[0]))
    for name in ("cloth", "sphere_0", "sphere_1"):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/run/{name}"))
        assert (
            mesh.GetNormalsInterpolation() == "vertex"
            and mesh.GetSubdivisionSchemeAttr().Get() == "none"
        )
        assert mesh.GetOrientationAttr().Get() == "rightHanded" and set(
            mesh.GetFaceVertexCountsAttr().Get()
        ) == {3}
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        x = (
            np.array(mesh.GetPointsAttr().Get(k), float)
            + mesh.ComputeLocalToWorldTransform(k).ExtractTranslation()
        )
        st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
        yield (
            x,
            corners,
            np.array(mesh.GetNormalsAttr().Get(k)),
            np.array(st.Get()) if st.IsDefined() else None,
        )


def read_obj(files, k):
    meshio = pytest.importorskip("meshio")
    mesh = meshio.read(files[k])
    objects = [line for line in files[k].read_text().splitlines() if line.startswith("o ")]
    assert (
        objects == ["o cloth", "o sphere_0", "o sphere_1"] and files[k].name == f"a_{k + 1:04d}.obj"
    )
    each, faces = (len(mesh.points) - 35) // 2, mesh.cells_dict["triangle"]
    for low, high in ((0, 35), (35, 35 + each), (35 + each, 35 + 2 * each)):
        own = faces[(faces >= low).all(axis=1) & (faces < high).all(axis=1)] - low
        yield (
            mesh.points[low:high],
            own,
            mesh.point_data["obj:vn"][low:high],
            mesh.point_data["obj:vt"][low:high],
        )


def read_ply(files, k):
    meshio = pytest.importorskip("meshio")
    assert [f.name for f in files[3 * k : 3 * k + 3]] == [
        f"a{b}_{k + 1:04d}.ply" for b in ("", "_sphere_0", "_sphere_1")
    ]
    for mesh in map(meshio.read, files[3 * k : 3 * k + 3]):
        directions, st = (
            np.stack([mesh.point_data[n] for n in names], -1)
            for names in (("nx", "ny", "nz"), "st")
        )
        yield mesh.points, mesh.cells_dict["triangle"], directions, st


@pytest.mark.parametrize("z_up", [False, True])
@pytest.mark.parametrize(
    ("suffix", "read"),
    [("usda", read_usd), ("usdc", read_usd), ("obj", read_obj), ("ply", read_ply)],
)
def test_surfaces_are_those_of_the_run(run, tmp_path, suffix, read, z_up):
    """The cloth; and spheres, which are on the true one, closed, and wound outwards."""
    if read is read_usd:
        pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    files = export(run, tmp_path / f"a.{suffix}", FPS, z_up)
    for k in range(11):
        cloth, *balls = read(files, k)
        x = points(run, k, z_up)
        close(cloth[0], x)
        assert (cloth[1] == TRIANGLES).all()
        close(cloth[2], normals(x), 1e-5)
        close(cloth[3], TEXTURE)
        for sphere, (vertices, corners, directions, _) in zip(
            run.scene.spheres, balls, strict=True
        ):
            center = turned(sphere.center_at(run.t[k]), z_up)
            close(np.linalg.norm(vertices - center, axis=-1), sphere.radius, 8 * SINGLE)
            close(directions, (vertices - center) / sphere.radius, 1e-5)
            a, b, c = (vertices[corners[:, n]] - center for n in range(3))
            volume = np.einsum("nk,nk->n", a, np.cross(b, c)) / 6
            assert (volume > 0).all() and volume.sum() == pytest.approx(
                4 / 3 * np.pi * sphere.radius**3, rel=0.01
            )


@pytest.mark.parametrize("z_up", [False, True])
def test_usd_says_what_its_numbers_mean(run, tmp_path, z_up):
    pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    from pxr import Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(export(run, tmp_path / "a.usdc", FPS, z_up)[0]))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.GetStageUpAxis(stage) == (
        "Z" if z_up else "Y"
    )
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == FPS
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (
        0,
        10,
    ) and stage.GetDefaultPrim().GetPath() == "/run"
    for name, color in (("cloth", CLOTH_FRONT), ("sphere_0", SPHERE), ("sphere_1", SPHERE)):
        prim, material = stage.GetPrimAtPath(f"/run/{name}"), name.split("_")[0]
        bound = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        assert bound.GetPath() == f"/run/materials/{material}"
        close(
            np.array(UsdGeom.Mesh(prim).GetDisplayColorAttr().Get()[0]),
            linear_light_of_color(color),
            1e-7,
        )
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth"))
    assert mesh.GetPointsAttr().GetTimeSamples() == list(range(11))
    for k in range(11):
        x = points(run, k, z_up)
        close(np.array(mesh.GetVelocitiesAttr().Get(k)), turned(run.v[k].reshape(-1, 3), z_up))
        close(np.array(mesh.GetExtentAttr().Get(k)), [x.min(axis=0), x.max(axis=0)])
    # Frames at their own times.
    uneven = cs.Run(run.scene, run.t[[0, 1, 4]], run.x[[0, 1, 4]], run.v[[0, 1, 4]], run.report)
    stage = Usd.Stage.Open(str(export(uneven, tmp_path / "b.usdc")[0]))
    codes = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth")).GetPointsAttr().GetTimeSamples()
    np.testing.assert_allclose(
        np.array(codes) / stage.GetTimeCodesPerSecond(), uneven.t, rtol=1e-12
    )
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
    assert (values(primitive.indices).reshape(-1, 3) == TRIANGLES).all()
    close(values(primitive.attributes.TEXCOORD_0), [0, 1] + TEXTURE * [1, -1])

    channels = {
        (c.target.node, c.target.path): file.animations[0].samplers[c.sampler]
        for c in file.animations[0].channels
    }
    assert set(channels) == {(0, "weights"), (1, "translation")}
    assert {s.interpolation for s in channels.values()} == {"LINEAR"}
    weights = channels[0, "weights"]
    close(values(weights.input)[:, 0], run.t)
    table = values(weights.output).reshape(len(run.t), len(primitive.targets))
    deltas = {
        name: np.array([values(target[name]) for target in primitive.targets])
        for name in ("POSITION", "NORMAL")
    }
    for k in range(len(run.t)):
        x = points(run, k)
        shape = {n: first[n] + np.einsum("t,tpc->pc", table[k], deltas[n]) for n in deltas}
        close(shape["POSITION"], x, 2 * SINGLE)
        close(shape["NORMAL"], normals(x), 3e-3 if k == 0 else 2 * SINGLE)
    # Blender shades a triangle flat in all frames where its corners have its own normal in the
    # first one.
    a, b, c = np.moveaxis(first["POSITION"][TRIANGLES].astype(float), 1, 0)
    own = np.cross(b - a, c - a)
    own /= np.linalg.norm(own, axis=-1, keepdims=True)
    assert ((own * first["NORMAL"][TRIANGLES[:, 0]]).sum(-1) < 0.9999999).all()
    close(np.linalg.norm(first["NORMAL"], axis=-1), 1.0, 2 * SINGLE)
    drawn = [linear_light_of_color(CLOTH_FRONT), linear_light_of_color(SPHERE)]
    assert [m.pbrMetallicRoughness.baseColorFactor[:3] for m in file.materials] == [
        list(color) for color in drawn
    ]
    # Half way between two frames importers show their mean.
    mean = first["POSITION"] + np.einsum("t,tpc->pc", table[3:5].mean(0), deltas["POSITION"])
    close(mean, (points(run, 3) + points(run, 4)) / 2, 2 * SINGLE)

    sphere = run.scene.spheres[0]
    close(values(channels[1, "translation"].output), sphere.center_at(run.t))
    for node, sphere in zip((moving, resting), run.scene.spheres):
        close(node.translation, sphere.center_at(0.0))
        ball = values(file.meshes[node.mesh].primitives[0].attributes.POSITION)
        close(np.linalg.norm(ball, axis=-1), sphere.radius, SINGLE)


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
    assert (np.array(corners) == TRIANGLES).all()
    with pytest.raises(ValueError, match=r"fps must be a number for \.pc2"):
        export(cs.simulate(run.scene, 0.1, dt=1e-3, every=0.03), tmp_path / "b.pc2")


def test_pvd_with_vtp_by_vtk(run, tmp_path):
    vtk = pytest.importorskip("vtk", reason="needs vtk: make test-export")
    from vtk.util.numpy_support import vtk_to_numpy

    index, *files = export(run, tmp_path / "a.pvd", FPS)
    assert index == tmp_path / "a.pvd"
    entries = ElementTree.parse(index).getroot().findall("Collection/DataSet")
    assert [e.get("file") for e in entries] == [file.name for file in files]
    assert [e.get("part") for e in entries] == ["0", "1", "2"] * 11
    reader, deepest = vtk.vtkXMLPolyDataReader(), 0.0
    for n, e in enumerate(entries):
        reader.SetFileName(str(tmp_path / e.get("file")))
        reader.Update()
        k, part, mesh = n // 3, n % 3, reader.GetOutput()
        assert float(e.get("timestep")) == k / FPS
        x, arrays = vtk_to_numpy(mesh.GetPoints().GetData()), mesh.GetPointData()
        if part:
            sphere = run.scene.spheres[part - 1]
            close(np.linalg.norm(x - sphere.center_at(run.t[k]), axis=-1), sphere.radius, 1e-12)
            continue
        assert (x == points(run, k)).all()  # float64
        assert (
            vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3) == TRIANGLES
        ).all()
        below = [
            s.radius - np.linalg.norm(x - s.center_at(run.t[k]), axis=-1) for s in run.scene.spheres
        ]
        depth = np.maximum(np.max(below, axis=0), 0)
        deepest = max(deepest, depth.max())
        expected = {
            "velocity": run.v[k].reshape(-1, 3),
            "depth": depth,
            "Normals": normals(x),
            "TCoords": TEXTURE,
        }
        for name, values in expected.items():
            close(vtk_to_numpy(arrays.GetArray(name)), values)
    assert deepest >= 0.04 - 1e-9  # else all depths would be 0


# Which frames are written


def moving(path, velocity, t, shape=(3, 4)):
    """Return a run in which every mass point follows `path` along y from its place on the flat
    sheet.
    """
    scene = cs.Scene(cs.Cloth(shape=shape))
    t = np.asarray(t, dtype=float)
    x = np.repeat(scene.initial_position[None], len(t), 0)
    x[..., 1] = path(t)[:, None, None]
    v = np.zeros_like(x)
    v[..., 1] = velocity(t)[:, None, None]
    return SimpleNamespace(scene=scene, t=t, x=x, v=v)


def test_frames_between_stored_ones_of_a_cubic_motion_are_exact():
    run = moving(
        lambda t: t**3 - 2 * t**2 + t, lambda t: 3 * t**2 - 4 * t + 1, [0, 0.1, 0.25, 0.3, 0.6]
    )
    clip = Clip(run, 30, False)
    assert len(clip) == 19
    for frame in clip.make_frames():
        t = frame.number / 30
        np.testing.assert_allclose(frame.positions[:, 1], t**3 - 2 * t**2 + t, atol=1e-14)
        np.testing.assert_allclose(frame.velocities[:, 1], 3 * t**2 - 4 * t + 1, atol=1e-13)


def test_frames_that_cannot_be_interpolated_are_refused_and_doubtful_ones_warned_of(tmp_path):
    ends = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3)
    with pytest.raises(ValueError, match=r"got 2 frames; simulate with every=0.0166667"):
        export(ends, tmp_path / "a.pc2", 60)
    spacing = 1 / 3
    # The neighbours of the middle frame lie still at 0, and so does their interpolant.
    bounces = [
        moving(lambda t, e=e: e * spacing * (t == 1), np.zeros_like, [0, 1, 2])
        for e in (1.5, 0.5, 0.09)
    ]
    with pytest.raises(ValueError, match="too far apart.*wrong by 0.5 m"):
        Clip(bounces[0], 2, False)
    with pytest.warns(UserWarning, match="wrong by 0.167 m, with a grid spacing of 0.333"):
        Clip(bounces[1], 2, False)
    Clip(bounces[2], 2, False)
    assert not list(tmp_path.iterdir())


def test_frames_between_stored_ones_stay_outside_a_sphere_and_move_driven_pins():
    cloth = cs.Cloth((9, 9), pins={(0, 0): cs.Linear((0.0, 0.3, 0.0)), (0, 8): None})
    sphere = cs.Sphere((0.5, -0.27, 0.5), 0.25)
    run = cs.simulate(cs.Scene(cloth, sphere), 0.4, dt=1e-3, every=0.02)
    for frame in Clip(run, 137, False).make_frames():
        assert frame.positions[0] == pytest.approx((0, 0.3 * frame.time, 0), abs=1e-12)
        assert np.linalg.norm(frame.positions - sphere.center, axis=-1).min() > sphere.radius


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.fbx",), r"path must end in one of \.usdc, \.usda, .*\.pc2, got '.*a\.fbx'"),
        *(((f"a{gone}",), r"must end in one of \.usdc") for gone in (".mdd", ".vtkhdf", ".csv")),
        (("a.obj", 3), r"fps must be at least 5 for a run of 0\.2 s, got 3"),
        (("a.glb", 60, True), "z_up must be False for .glb"),
    ],
)
def test_a_wrong_argument_is_refused_before_any_work(run, tmp_path, arguments, message):
    name, *others = arguments
    with pytest.raises(ValueError, match=message):
        export(run, tmp_path / name, *others)
    with pytest.raises(ValueError, match="at least 2 x 2 mass points"):
        export(cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-2), tmp_path / "a.obj")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("fps", [30, 50.0])
def test_the_frames_of_the_run_are_exported_unless_told_otherwise(tmp_path, fps):
    run = cs.simulate(cs.scenes.paper_swing(), 0.5, dt=1e-3, fps=fps)
    clip = Clip(run, None, False)
    assert clip.fps == fps
    assert len(run.export(tmp_path / "a.ply")) == len(run) == len(clip)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("fps", [None, 30.0])
def test_a_run_of_one_frame_is_exported(run, tmp_path, suffix, fps):
    if FORMATS[suffix] == "usd":
        pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    one = run[4:5]
    files = one.export(tmp_path / f"a{suffix}", fps=fps)
    assert files and all(file.stat().st_size > 100 for file in files)
    if suffix == ".glb":
        file = pytest.importorskip("pygltflib").GLTF2().load(str(files[0]))
        assert not file.animations and not file.meshes[0].primitives[0].targets
        assert all(accessor.count for accessor in file.accessors)


def times_of(path):
    """Return the times [s] of the frames in a file."""
    if path.suffix == ".pvd":
        entries = ElementTree.parse(path).getroot().findall("Collection/DataSet")
        return sorted({float(entry.get("timestep")) for entry in entries})
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    codes = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth")).GetPointsAttr().GetTimeSamples()
    assert [stage.GetStartTimeCode(), stage.GetEndTimeCode()] == [codes[0], codes[-1]]
    return np.array(codes) / stage.GetTimeCodesPerSecond()


@pytest.mark.parametrize("suffix", ["pvd", "usda"])
@pytest.mark.parametrize("start", [0.0, 5.0, 0.013])
def test_frames_keep_the_times_of_the_run(run, tmp_path, suffix, start):
    if suffix == "usda":
        pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    later = cs.simulate(run.scene.replace(spheres=()), 0.11, dt=1e-3, fps=30, t=start)
    (path, *_) = later.export(tmp_path / f"a.{suffix}")
    assert times_of(path) == pytest.approx(later.t, rel=1e-12)


def test_a_usd_of_a_run_that_ends_in_a_part_of_a_frame_has_the_rate_of_the_run(run, tmp_path):
    pytest.importorskip("pxr", reason="needs usd-core, in the extra export")
    from pxr import Usd, UsdGeom

    odd = cs.simulate(run.scene.replace(spheres=()), 0.11, dt=1e-3, fps=30)
    stage = Usd.Stage.Open(str(odd.export(tmp_path / "a.usda")[0]))
    codes = UsdGeom.Mesh(stage.GetPrimAtPath("/run/cloth")).GetPointsAttr().GetTimeSamples()
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30
    assert codes == pytest.approx([0, 1, 2, 3, 3.3]) and codes[:4] == [0, 1, 2, 3]


def test_an_xarray_of_a_run_goes_to_zarr_without_a_warning(run, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    data = run.to_xarray()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # xarray asks zarr for this in every store, and zarr warns of it.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        data.to_zarr(tmp_path / "run.zarr")
    assert xarray.open_zarr(tmp_path / "run.zarr").load().equals(data)
