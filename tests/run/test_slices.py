"""Frames and mass points of a run, meshes of other packages, and the difference of two runs."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.scale import point_stretch


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.scenes.paper_swing(), 0.2, dt=1e-3, fps=50)


def test_a_slice_is_a_run_of_these_frames(run):
    part = run[2:8:3]
    assert len(run) == 11 and len(part) == 2
    assert part.t.tolist() == run.t[[2, 5]].tolist()
    assert np.array_equal(part.x, run.x[[2, 5]]) and np.array_equal(part.v, run.v[[2, 5]])
    assert part.report == run.report and part.scene == run.scene
    assert run[:] == run


def test_only_a_part_with_the_last_frame_can_be_resumed(run, tmp_path):
    assert run[-3:].resume(0.05) == run.resume(0.05)
    with pytest.raises(ValueError, match="final state was not kept"):
        run[:3].resume(0.05)
    assert cs.load_run(run[:3].save(tmp_path / "part")) == run[:3]


def test_a_mass_point_over_the_frames_has_the_stretch_of_the_page(run):
    point = run.at(-1, 5)
    assert np.array_equal(point["x"], run.x[:, 31, 5]) and np.array_equal(
        point["v"], run.v[:, 31, 5]
    )
    assert np.array_equal(point["speed"], np.linalg.norm(run.v[:, 31, 5], axis=-1))
    expected = point_stretch(run.scene, run.x).reshape(11, 32, 32)
    for row, column in ((31, 5), (0, 0), (7, 13), (16, 2), (31, 31)):
        assert np.array_equal(run.at(row, column)["stretch"], expected[:, row, column])
    assert point["stretch"].max() > 1e-3
    with pytest.raises(ValueError, match="row must be .* 31, got 32"):
        run.at(32, 0)


def test_rms_and_maximum_are_over_the_mass_points(run):
    x = run.x.copy()
    x[4, 1, 2, 0] += 0.32
    difference = cs.difference(run, cs.Run(run.scene, run.t, x, run.v, {}))
    assert difference["max"][4] == pytest.approx(0.32) and difference["rms"][4] == pytest.approx(
        0.01
    )
    assert np.delete(difference["max"], 4).max() == 0


def test_frames_pair_off_to_half_a_step(run):
    """Times in float32 are those of the run, and half a step later is another time."""
    rounded = cs.Run(run.scene, run.t.astype(np.float32).astype(float), run.x, run.v, {})
    difference = cs.difference(run, rounded)
    assert len(difference["t"]) == len(run) and difference["unmatched"] == 0
    step = run.report["dt"]
    times = run.t[3:7]
    for shift, unmatched in ((0.4, 0), (0.6, 2 * len(times))):
        other = cs.Run(run.scene, np.append(times + shift * step, 99.0), run.x[3:8], run.v[3:8], {})
        part = cs.Run(run.scene, np.append(times, 99.0), run.x[3:8], run.v[3:8], run.report)
        assert cs.difference(part, other)["unmatched"] == unmatched
    assert cs.difference(run, run[2:4])["unmatched"] == len(run) - 2
