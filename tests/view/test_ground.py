"""A sphere as large as a floor leaves the cloth its place in every picture, film and page."""

import json

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing.camera import camera_for

RADII = [1.0, 1e3, 1e5]
GAP = 0.49  # m below the flat sheet


def scene(radius):
    """A light sheet that falls on a floor."""
    floor = cs.Sphere((0.5, -GAP - radius, 0.5), radius, offset="none")
    return cs.Scene(cs.Cloth((24, 24), mass=0.3, stiffness=200.0, damping=0.02), floor)


@pytest.fixture(scope="module")
def runs():
    """For each radius the run, and the same frames without the floor."""
    found = {}
    for radius in RADII:
        run = cs.simulate(scene(radius), 0.8, dt=1e-3, fps=10)
        found[radius] = run, cs.Run(run.scene.replace(spheres=()), run.t, run.x, run.v, run.report)
    return found


def share(picture):
    """Part of a picture that has the colours of cloth."""
    colors = np.asarray(picture).astype(int)
    return (np.ptp(colors, axis=-1) > 25).mean()


def meta(path):
    return json.loads(path.read_text().split('id="meta">')[1].split("</script>")[0])


@pytest.mark.parametrize("options", [{}, {"ground": False}], ids=str)
@pytest.mark.parametrize("radius", RADII)
def test_a_picture_shows_as_much_cloth_with_a_floor_as_without(runs, radius, options):
    ground = scene(radius)
    bare = share(cs.picture(ground.replace(spheres=()), **options))
    assert bare > 0.3 and share(cs.picture(ground, **options)) == pytest.approx(bare, rel=0.2)
    for frame in (0, 5, 8):
        with_floor, without = (share(run.picture(frame, **options)) for run in runs[radius])
        assert without > 0.05 and with_floor == pytest.approx(without, rel=0.2)


@pytest.mark.parametrize("radius", RADII[-2:])
def test_cloth_that_lies_on_a_floor_is_drawn_as_without_it(runs, radius):
    """Its points are at the radius up to rounding, which is no penetration."""
    floor, bare = (np.asarray(run.picture()).astype(int) for run in runs[radius])
    cloth = np.ptp(bare, axis=-1) > 25
    assert np.abs(floor - bare)[cloth].max(axis=-1).mean() < 1


@pytest.mark.parametrize("radius", RADII)
def test_pages_get_the_camera_of_the_cloth(runs, radius, tmp_path):
    run, bare = runs[radius]
    given = [meta(one.to_html(tmp_path / "a.html")) for one in (run, bare)]
    assert given[0]["camera"] == given[1]["camera"]
    (sphere,) = given[0]["runs"][0]["spheres"]
    assert sphere["centers"] == [list(run.scene.spheres[0].center)]
    live = [meta(one.scene.to_live_html(tmp_path / "a.html"))["camera"] for one in (run, bare)]
    assert live[0]["width"] <= live[1]["width"]  # it frames the motion, which ends on the floor, but not the floor


def test_a_small_sphere_is_framed_while_it_is_near():
    cloth = cs.Cloth((6, 6))
    near, passing = cs.Sphere((0.5, -0.3, 0.5), 0.25), cs.Sphere((0.5, 0.6, 0.5), 0.1, cs.Linear((50.0, 0, 0)))
    t = np.linspace(0, 1, 51)
    x = np.broadcast_to(cloth.rest_positions, (51, 6, 6, 3))
    one, two = (camera_for("front", cs.Scene(cloth, spheres), x, t) for spheres in (near, [near, passing]))
    assert 0.55 < one.height < 0.8  # m, of which 0.55 at the target
    assert two.width < 6  # m; the sphere flies 50 m


def test_the_eye_looks_through_a_floor_from_below_and_through_a_wall():
    wall = cs.Sphere((100.0 + 1.2, 0, 0.5), 100.0)
    for ground, camera in ((scene(1e3), "below"), (scene(1e3).replace(spheres=wall), "corner")):
        bare = share(cs.picture(ground.replace(spheres=()), camera=camera))
        assert share(cs.picture(ground, camera=camera)) == bare > 0.3
