"""Which frames `Run.export` writes, and that a failed export leaves nothing behind."""

from types import SimpleNamespace

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing import exports as exporting
from clothsim.viewing.exports import Clip, between, interpolation_error
from clothsim.viewing.formats.meshes import unit_ball


@pytest.fixture(scope="module")
def run():
    scene = cs.scenes.paper_moving()
    return cs.simulate(scene, 0.1, dt=1e-3, every=0.01)


def moving(path, velocity, t, shape=(3, 4)):
    """A run in which every mass point follows `path` along y from its place on the flat sheet."""
    scene = cs.Scene(cs.Cloth(shape=shape))
    t = np.asarray(t, dtype=float)
    x = np.repeat(scene.initial_position[None], len(t), 0)
    x[..., 1] = path(t)[:, None, None]
    v = np.zeros_like(x)
    v[..., 1] = velocity(t)[:, None, None]
    return SimpleNamespace(scene=scene, t=t, x=x, v=v)


def test_frames_between_stored_ones_of_a_cubic_motion_are_exact():
    run = moving(lambda t: t**3 - 2 * t**2 + t, lambda t: 3 * t**2 - 4 * t + 1, [0, 0.1, 0.25, 0.3, 0.6])
    clip = Clip(run, 30, False)
    assert len(clip) == 19
    for frame in clip.frames():
        t = frame.number / 30
        np.testing.assert_allclose(frame.positions[:, 1], t**3 - 2 * t**2 + t, atol=1e-14)
        np.testing.assert_allclose(frame.velocities[:, 1], 3 * t**2 - 4 * t + 1, atol=1e-13)


def test_the_error_of_interpolation_is_of_fourth_order_with_the_known_constant():
    """At the middle of a gap h, that of sin(w t) is w^4 h^4 sin / 384, as for any Hermite cubic."""
    h, w = 0.02, 10.0
    for gap in (h, h / 2):
        run = moving(lambda t: np.sin(w * t), lambda t: w * np.cos(w * t), np.arange(0, 1, gap))
        k = len(run.t) // 2
        t = run.t[k] + gap / 2
        x, _ = between(run, k, k + 1, t)
        expected = (w * gap) ** 4 / 384 * np.sin(w * t)
        assert x[0, 0, 1] - np.sin(w * t) == pytest.approx(-expected, rel=0.01)
        assert interpolation_error(run) == pytest.approx((2 * w * gap) ** 4 / 384, rel=0.02)


def test_a_frame_that_is_stored_is_taken_as_it_is(run):
    clip = Clip(run, 100, False)
    assert len(clip) == 11
    for frame in clip.frames():
        assert (frame.positions == run.x[frame.number].reshape(-1, 3)).all()
        assert (frame.velocities == run.v[frame.number].reshape(-1, 3)).all()


def test_frames_that_cannot_be_interpolated_are_refused_and_doubtful_ones_warned_of(tmp_path):
    ends = cs.simulate(cs.scenes.paper_swing(), 0.1, dt=1e-3)
    with pytest.raises(ValueError, match=r"got 2 frames; simulate with every=0.0166667"):
        exporting.export(ends, tmp_path / "a.pc2", 60)
    spacing = 1 / 3
    for error, outcome in ((1.5, ValueError), (0.5, UserWarning), (0.09, None)):
        # The neighbours of the middle frame lie still at 0, and so does their interpolant.
        bounce = moving(lambda t: error * spacing * (t == 1), np.zeros_like, [0, 1, 2])
        if outcome is None:
            Clip(bounce, 2, False)
        elif outcome is UserWarning:
            with pytest.warns(UserWarning, match="wrong by 0.167 m, with a grid spacing of 0.333"):
                Clip(bounce, 2, False)
        else:
            with pytest.raises(ValueError, match="too far apart.*wrong by 0.5 m"):
                Clip(bounce, 2, False)
    assert not list(tmp_path.iterdir())


def test_normals_of_the_flat_sheet_point_up_and_texture_coordinates_are_not_mirrored(run):
    clip = Clip(run, None, False)
    flat = run.scene.cloth.rest_positions.reshape(-1, 3)
    assert (clip.normals(flat) == [0, 1, 0]).all()
    np.testing.assert_allclose(clip.uv, np.stack([flat[:, 0], 1 - flat[:, 2]], -1), atol=1e-15)
    turned = Clip(run, None, True)
    np.testing.assert_array_equal(turned[3].positions, clip[3].positions[:, [0, 2, 1]] * [1, -1, 1])
    np.testing.assert_array_equal(turned[3].centers, clip[3].centers[:, [0, 2, 1]] * [1, -1, 1])


def test_normals_of_a_ball_point_outwards_and_a_lost_vertex_gets_one_as_well(run):
    vertices, corners, _ = unit_ball()
    assert np.linalg.norm(vertices, axis=-1) == pytest.approx(1, abs=1e-15)
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    volume = np.einsum("nk,nk->n", a, np.cross(b, c)) / 6
    assert (volume > 0).all() and volume.sum() == pytest.approx(4 * np.pi / 3, rel=0.01)
    flat = run.scene.cloth.rest_positions.reshape(-1, 3)
    assert (Clip(run, None, False).normals(flat * 0) == [0, 1, 0]).all()


def test_frames_between_stored_ones_stay_outside_a_sphere_and_move_driven_pins():
    cloth = cs.Cloth((9, 9), pins={(0, 0): cs.Linear((0.0, 0.3, 0.0)), (0, 8): None})
    sphere = cs.Sphere((0.5, -0.27, 0.5), 0.25)
    run = cs.simulate(cs.Scene(cloth, sphere), 0.4, dt=1e-3, every=0.02)
    for frame in Clip(run, 137, False).frames():
        assert frame.positions[0] == pytest.approx((0, 0.3 * frame.time, 0), abs=1e-12)
        assert np.linalg.norm(frame.positions - sphere.center, axis=-1).min() > sphere.radius


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.fbx",), r"path must end in one of \.usdc, \.usda, .*\.pc2, got '.*a\.fbx'"),
        *(((f"a{gone}",), r"must end in one of \.usdc") for gone in (".mdd", ".vtkhdf", ".csv")),
        (("a.obj", 5), r"fps must be at least 10 for a run of 0\.1 s, got 5"),
        (("a.glb", 60, True), "z_up must be False for .glb"),
    ],
)
def test_a_wrong_argument_is_refused_before_any_work(run, tmp_path, arguments, message):
    name, *others = arguments
    with pytest.raises(ValueError, match=message):
        exporting.export(run, tmp_path / name, *others)
    assert not list(tmp_path.iterdir())


def test_a_chain_has_no_surface_to_export(tmp_path):
    scene = cs.scenes.oscillator()
    assert min(scene.cloth.shape) == 1
    chain = cs.simulate(scene, 0.1, dt=1e-2, every="step")
    with pytest.raises(ValueError, match="at least 2 x 2 mass points"):
        exporting.export(chain, tmp_path / "a.obj")


@pytest.mark.parametrize("suffix", exporting.FORMATS)
def test_a_failure_half_way_leaves_the_folder_as_it_was(run, tmp_path, monkeypatch, suffix):
    if exporting.FORMATS[suffix] == "usd":
        pytest.importorskip("pxr")
    earlier = tmp_path / f"a{suffix}"
    earlier.write_text("earlier")
    calls, get = [], Clip.__getitem__

    def fail(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise OSError("disk full")
        return get(*arguments)

    monkeypatch.setattr(Clip, "__getitem__", fail)
    with pytest.raises(OSError, match="disk full"):
        exporting.export(run, earlier)
    assert [file.name for file in tmp_path.iterdir()] == [earlier.name]
    assert earlier.read_text() == "earlier"


@pytest.mark.parametrize("fps", [30, 50.0])
def test_the_frames_of_the_run_are_exported_unless_told_otherwise(tmp_path, fps):
    run = cs.simulate(cs.scenes.paper_swing(), 0.5, dt=1e-3, fps=fps)
    clip = Clip(run, None, False)
    assert clip.fps == fps
    assert len(run.export(tmp_path / "a.ply")) == len(run) == len(clip)
