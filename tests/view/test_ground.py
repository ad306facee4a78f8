"""Floors: a `Plane`, and a sphere as large as one, leave the cloth its place in every picture, page
and export.
"""

import json

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.camera import make_camera
from clothsim.viewing.exports import Clip
from clothsim.viewing.formats.meshes import frame_bodies
from clothsim.viewing.plots.run import curves_over_frames

GAP = 0.49  # m below the flat sheet
CLOTH = cs.Cloth((24, 24), mass=0.3, stiffness=200.0, damping=0.02)
FLOORS = {
    "plane": cs.Plane((0.0, -GAP, 0.0)),
    **{f"{r:g}": cs.Sphere((0.5, -GAP - r, 0.5), r, offset="none") for r in (1.0, 1e5)},
}
WALL = cs.Plane((0.0, -0.3, 0.0), (0.2, 1.0, 0.1), motion=cs.Linear((0.0, 0.1, 0.0)), friction=0.8)
LOOSE = cs.Cloth((8, 8), mass=0.3, stiffness=60.0, damping=0.02, pins=())
RED = np.array([1.0, -0.5, -0.5])  # against grey


@pytest.fixture(scope="module", params=FLOORS)
def runs(request):
    """Return a run of a light sheet that falls on a floor, and its frames without the floor."""
    run = cs.simulate(cs.Scene(CLOTH, FLOORS[request.param]), 0.8, dt=2e-4, fps=10)
    return run, cs.Run(run.scene.replace(spheres=()), run.t, run.x, run.v, run.report)


def share(picture):
    """Return the part of a picture that has the colours of cloth."""
    colors = np.asarray(picture).astype(int)
    return (np.ptp(colors, axis=-1) > 25).mean()


def meta(path):
    return json.loads(path.read_text().split('id="meta">')[1].split("</script>")[0])


@pytest.mark.parametrize("options", [{}, {"ground": False}], ids=str)
def test_a_picture_shows_as_much_cloth_with_a_floor_as_without(runs, options):
    start, bare = (share(cs.picture(one.scene, **options)) for one in runs)
    assert bare > 0.3 and start == pytest.approx(bare, rel=0.2)
    for frame in (5, 8):
        with_floor, without = (share(run.picture(frame, **options)) for run in runs)
        assert without > 0.05 and with_floor == pytest.approx(without, rel=0.2)


@pytest.mark.parametrize("runs", ["plane", "100000"], indirect=True)
def test_cloth_that_lies_on_a_floor_is_drawn_as_without_it(runs):
    """Its points are at the surface up to rounding, which is no penetration."""
    floor, bare = (np.asarray(run.picture()).astype(int) for run in runs)
    cloth = np.ptp(bare, axis=-1) > 25
    assert np.abs(floor - bare)[cloth].max(axis=-1).mean() < 1


def test_pages_get_the_camera_of_the_cloth(runs, tmp_path):
    run, bare = runs
    given = [
        meta(one.to_html(tmp_path / "a.html")) for one in (run, bare)
    ]  # raises where a number has no JSON
    assert given[0]["camera"] == given[1]["camera"]
    live = [meta(one.scene.to_live_html(tmp_path / "a.html"))["camera"] for one in (run, bare)]
    assert (
        live[0]["width"] <= live[1]["width"]
    )  # it frames the motion, which ends on the floor, but not the floor


def test_a_small_sphere_is_framed_while_it_is_near():
    cloth = cs.Cloth((6, 6))
    near, passing = (
        cs.Sphere((0.5, -0.3, 0.5), 0.25),
        cs.Sphere((0.5, 0.6, 0.5), 0.1, cs.Linear((50.0, 0, 0))),
    )
    t = np.linspace(0, 1, 51)
    x = np.broadcast_to(cloth.rest_positions, (51, 6, 6, 3))
    one, two = (
        make_camera("front", cs.Scene(cloth, spheres), x, t) for spheres in (near, [near, passing])
    )
    assert 0.55 < one.height < 0.8  # m, of which 0.55 at the target
    assert two.width < 6  # m; the sphere flies 50 m


def test_the_eye_looks_through_a_floor_from_below_and_through_a_wall():
    for solid, camera in (
        (FLOORS["100000"], "below"),
        (cs.Sphere((100.0 + 1.2, 0, 0.5), 100.0), "corner"),
    ):
        bare, seen = (share(cs.picture(cs.Scene(CLOTH, one), camera=camera)) for one in ((), solid))
        assert seen == bare > 0.3


def test_cloth_below_a_plane_is_red():
    floor = cs.Scene(LOOSE, cs.Plane((5.0, -0.1, 3.0)))
    above, below = (
        cs.picture(floor, LOOSE.rest_positions + [0, y, 0], width=160).pixels for y in (0.0, -0.15)
    )
    assert (above @ RED).max() < 60 < 150 < (below @ RED).max()


@pytest.mark.parametrize("z_up", [False, True])
def test_a_plane_is_touched_and_exported_as_a_square_three_times_as_wide_as_the_scene(z_up):
    run = cs.simulate(cs.Scene(LOOSE, WALL), 1.0, dt=4e-5, fps=10)
    contacts = curves_over_frames(run)["contacts"]
    assert contacts[0] == 0 and contacts[-1] == LOOSE.shape[0] * LOOSE.shape[1]
    clip = Clip(run, None, z_up)
    for k in (0, len(clip) - 1):
        _, square = frame_bodies(clip, clip[k])
        assert square.name == "plane_0"
        places = square.positions[:, [0, 2, 1]] * [1, 1, -1] if z_up else square.positions
        assert np.abs(WALL.height(places, run.t[k])).max() < 1e-12
        a, b, c = places[square.corners[0]]
        outward = np.cross(b - a, c - a)
        assert outward @ WALL.unit_normal == pytest.approx(np.linalg.norm(outward))
        longest = np.ptp(run.x, axis=(0, 1, 2)).max()
        assert np.linalg.norm(b - a) == pytest.approx(3 * longest)
        middle = (run.x.min(axis=(0, 1, 2)) + run.x.max(axis=(0, 1, 2))) / 2
        foot = middle - WALL.height(middle, run.t[k]) * WALL.unit_normal
        moved = WALL.center_at(run.t[k]) - WALL.center_at(0.0)
        along = moved - moved @ WALL.unit_normal * WALL.unit_normal
        assert places.mean(axis=0) == pytest.approx(foot + along, abs=1e-9)


def test_a_plane_stands_where_a_sphere_stands():
    pytest.importorskip("zarr")
    floor = WALL.replace(normal=(0, 1, 0))
    rest = cs.settle(cs.Scene(LOOSE, floor), t=1.0)
    layer, weight = floor.layer(LOOSE), 9.80665 * LOOSE.mass_per_point.mean()
    depth = (weight * layer["thickness"] ** 2 / layer["stiffness"]) ** (1 / 3)
    height = -0.2 + layer["thickness"] - depth
    assert rest.report["reason"] == "" and rest.x[-1][..., 1] == pytest.approx(height, abs=1e-6)
    assert "a plane" in str(rest.scene.explain())
    beside = cs.Scene(LOOSE, [cs.Sphere((0.5, -0.5, 0.5), 0.1), WALL])
    options = {"duration": 0.01, "dt": 1e-3, "metrics": ["stable"], "progress": False}
    assert cs.sweep(beside, {"sphere_radius": [0.1, 0.2]}, **options).stable.all()
    with pytest.raises(ValueError, match="spheres.1. is a plane"):
        cs.sweep(beside, {"sphere1_radius": [0.1]}, **options)
