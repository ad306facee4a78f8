"""A `Plane` in pictures, pages, exports and rest states."""

import clothsim as cs
import numpy as np
import pytest

CLOTH = cs.Cloth((8, 8), mass=0.3, stiffness=60.0, damping=0.02, pins=())
WALL = cs.Plane((0.0, -0.3, 0.0), (0.2, 1.0, 0.1), motion=cs.Linear((0.0, 0.1, 0.0)), friction=0.8)
RED = np.array([1.0, -0.5, -0.5])  # against grey


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.Scene(CLOTH, WALL), 0.4, dt=1e-3, fps=10)


def test_cloth_below_a_plane_is_red():
    floor = cs.Scene(CLOTH, cs.Plane((5.0, -0.1, 3.0)))
    above, below = (cs.picture(floor, CLOTH.rest_positions + [0, y, 0], width=160).pixels for y in (0.0, -0.15))
    assert (above @ RED).max() < 60 < 150 < (below @ RED).max()


def test_a_page_has_numbers_that_json_knows(run, tmp_path):
    run.to_html(tmp_path / "run.html")  # raises where a number has no JSON


@pytest.mark.parametrize("z_up", [False, True])
def test_an_exported_plane_is_a_square_on_it_below_the_cloth(run, z_up):
    exports, meshes = pytest.importorskip("clothsim.viewing.exports"), pytest.importorskip("clothsim.viewing.formats.meshes")
    clip = exports.Clip(run, None, z_up)
    for k in (0, len(clip) - 1):
        _, square = meshes.bodies(clip, clip[k])
        places = square.positions[:, [0, 2, 1]] * [1, 1, -1] if z_up else square.positions
        assert np.abs(WALL.height(places, run.t[k])).max() < 1e-12
        a, b, c = places[square.corners[0]]
        outward = np.cross(b - a, c - a)
        assert outward @ WALL.unit_normal == pytest.approx(np.linalg.norm(outward))
        assert np.ptp(square.positions, axis=0).max() > 3 * max(CLOTH.size)


def test_a_cloth_rests_on_a_plane():
    rest = cs.settle(cs.Scene(CLOTH, WALL.replace(normal=(0, 1, 0))), t=1.0)
    assert rest.report["reason"] == "" and rest.x[-1][..., 1] == pytest.approx(-0.2, abs=1e-6)


def test_explain_names_it():
    assert "a plane" in str(cs.Scene(CLOTH, WALL).explain())


def test_radii_are_those_of_spheres():
    pytest.importorskip("zarr")
    beside = cs.Scene(CLOTH, [cs.Sphere((0.5, -0.5, 0.5), 0.1), WALL])
    options = {"duration": 0.01, "dt": 1e-3, "metrics": ["stable"], "progress": False}
    assert cs.sweep(beside, {"sphere_radius": [0.1, 0.2]}, **options).stable.all()
    with pytest.raises(ValueError, match="spheres.1. is a plane"):
        cs.sweep(beside, {"sphere1_radius": [0.1]}, **options)


def test_contacts_are_points_on_the_plane(run):
    contacts = pytest.importorskip("clothsim.viewing.plots").curves(run)["contacts"]
    assert contacts[0] == 0 and contacts[-1] == CLOTH.shape[0] * CLOTH.shape[1]
