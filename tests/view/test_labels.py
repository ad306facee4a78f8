"""What a picture can show beside the scene: values as colours, a label, shadows, a ground, perspective."""

import re
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing import legend

ABOVE = cs.Camera((0.0, 1.0, 0.0), (0.5, 0.0, 0.5), 1.1, 1.1)
FLAT = cs.Scene(cs.Cloth(pins=()))


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.scenes.paper_static(), 0.5, dt=5e-4, every=0.05)


def hue(pixel):
    """A colour without its brightness, since the light on the cloth changes that alone."""
    pixel = np.asarray(pixel, float)
    return pixel / pixel.sum(axis=-1, keepdims=True)


def test_an_array_colours_each_mass_point_by_the_scale():
    values = np.add.outer(np.zeros(32), np.arange(32.0))
    pixels = cs.picture(FLAT, camera=ABOVE, width=550, color=values).pixels
    scale = legend.scale_of(values, values, None)
    for column in (0.5, 10.5, 20.5, 30.5):  # between grid lines
        x = round(550 * (0.5 + (column / 31 - 0.5) / 1.1))
        expected = hue(scale.colors(np.array(column)))
        assert hue(pixels[275 + 8, x]) == pytest.approx(expected, abs=0.01)


def test_a_value_that_is_unknown_is_grey():
    pixels = cs.picture(FLAT, camera=ABOVE, width=200, color=np.full((32, 32), np.nan)).pixels
    assert np.ptp(pixels[60:140, 60:140].astype(int), axis=-1).max() == 0


@pytest.mark.parametrize("name", ["stretch", "speed", "depth"])
def test_named_colours_follow_the_measure_on_one_scale(run, name):
    measure = {
        "stretch": lambda k: cs.largest_stretch(run.scene, run.x[k]),
        "speed": lambda k: np.linalg.norm(run.v[k], axis=-1).max(),
        "depth": lambda k: cs.penetration(run.x[k], run.scene.spheres[0])["points"],
    }[name]
    values = legend.values_of(name, run.scene, run.x, run.v, run.t)
    for k in (0, 5, 10):
        assert values[k].max() == pytest.approx(measure(k), abs=1e-12)
    # The scale of a run is that of all its frames; a state alone has its own.
    scale = legend.scale_of(name, values, None)
    own = cs.picture(run.scene, run.x[3], v=run.v[3], color=name, width=200).pixels
    same = run.picture(3, color=name, width=200, limits=(scale.low, scale.high)).pixels
    assert np.array_equal(run.picture(3, color=name, width=200).pixels, same)
    if name != "depth":
        assert not np.array_equal(own, same)


def test_colour_scales_are_those_of_the_pages_and_rise_in_lightness():
    script = Path(legend.__file__).with_name("web").joinpath("draw.js").read_text()
    for name in ("VIRIDIS", "HEAT"):
        stops = re.search(rf"const {name} = \[(.*?)\]", script)
        assert tuple(re.findall(r"[0-9a-f]{6}", stops[1])) == getattr(legend, name)
        colors = legend.Scale("", "", 1, 0, 1, getattr(legend, name), False).colors(np.linspace(0, 1, 50))
        assert (np.diff(colors @ [0.2126, 0.7152, 0.0722]) > 0).all() or (np.diff(colors @ [0.3, 0.6, 0.1]) < 0).all()


def test_a_label_is_a_strip_below_the_same_picture(run):
    plain, labelled = run.picture(4, width=400).pixels, run.picture(4, width=400, label=True, color="faces").pixels
    assert np.array_equal(labelled[: len(plain)], plain)
    strip = labelled[len(plain) :]
    assert (strip[[0, -1]] == 255).all() and (strip < 60).any()
    # A clock alone changes from frame to frame.
    other = run.picture(5, width=400, label=True).pixels[len(plain) :]
    columns = np.flatnonzero((strip != other).any(axis=(0, 2)))
    assert columns.size and columns.max() < 0.25 * 400


@pytest.mark.parametrize(("width", "scene_width"), [(400, 1.1), (640, 0.05), (900, 40.0)])
def test_the_length_in_a_label_is_that_of_the_picture(width, scene_width):
    view = cs.Camera((0, 1, 0), (0.5, 0, 0.5), scene_width, scene_width)
    strip = cs.picture(FLAT, camera=view, width=width, label=True).pixels[width:]
    dark = (strip < 60).all(axis=-1)
    row = np.flatnonzero(dark.sum(axis=1) == dark.sum(axis=1).max())[-1]
    line = np.flatnonzero(dark[row])
    longest = max(np.split(line, np.flatnonzero(np.diff(line) > 1) + 1), key=len)
    length = legend.nice_length(0.17 * scene_width)
    assert len(longest) == pytest.approx(length / scene_width * width, abs=1.5)


def test_a_label_says_as_printed():
    """In a strip of its own above the other one."""
    printed, mended = (
        cs.picture(cs.scenes.paper_static("ray", as_printed=one), width=400, label=True).pixels for one in (True, False)
    )
    strip, below = legend.labelled(mended[:1], 0.0, 400.0, None).shape[0] - 1, printed.shape[0] - mended.shape[0]
    assert np.array_equal(printed[-strip:], mended[-strip:])
    note = printed[-strip - below : -strip]
    columns = np.flatnonzero((note < 150).any(axis=(0, 2)))
    assert 0.1 * 400 < np.ptp(columns) < 0.25 * 400 and (note[[0, -1]] == 255).all()


def test_the_shadow_of_a_ball_lies_on_the_ground_away_from_the_light():
    """The light comes from (0.3, 1, 0.25): a ball 1 m above the ground shades the place 0.3 m and 0.25 m beside it."""
    from clothsim.viewing.raster import Ball, Ground, render

    sheet = np.zeros((2, 2, 3)) + (0, -5, 0)  # below the ground
    ball = Ball((0.0, 1.0, 0.0), 0.1, (0.5, 0.5, 0.5))
    view = cs.Camera((0, 1, 0), (0, 0, 0), 2.0, 2.0)
    ground = Ground(0.0, (0, 0, 0), 4.0)
    lit, dark = (render(sheet, [ball], view, 200, ground=ground, shadow=s)[..., 0].astype(int) for s in (False, True))
    darker = lit - dark
    rows, columns = np.nonzero(darker > 20)
    assert (columns.mean() - 99.5) / 100 == pytest.approx(-0.3, abs=0.02)
    assert (rows.mean() - 99.5) / 100 == pytest.approx(-0.25, abs=0.02)
    assert len(np.unique(darker)) > 20  # soft
    assert (darker >= 0).all()


def test_the_shadow_of_a_sheet_lies_below_it_and_is_sharper_the_nearer():
    from clothsim.viewing.raster import Ground, render

    view = cs.Camera((0, 1, 0.4), (0.5, 0, 0.5), 4.0, 4.0)
    edges = []
    for height in (0.1, 0.6):
        x = cs.Cloth((9, 9), pins=()).rest_positions + (0, height, 0)
        ground = Ground(0.0, (0.5, 0, 0.5), 40.0)
        lit, dark = (render(x, [], view, 400, ground=ground, shadow=s)[..., 0].astype(int) for s in (False, True))
        on_ground = (lit - dark)[np.abs(lit - lit[0, 0]) < 2]
        full = on_ground.max()
        assert (on_ground > 0.9 * full).sum() > 100
        edges.append(((on_ground > 0.1 * full) & (on_ground < 0.9 * full)).sum())
    assert edges[1] > 2 * edges[0] > 0


def test_a_ground_is_seen_from_above_alone_and_lies_under_all():
    scene = cs.scenes.paper_static()
    low = {name: cs.picture(scene, camera=name, width=100, ground=True).pixels for name in ("corner", "below")}
    assert np.array_equal(low["below"], cs.picture(scene, camera="below", width=100).pixels)
    plain = cs.picture(scene, camera="corner", width=100).pixels
    changed = (low["corner"] != plain).any(axis=-1)
    assert (plain[changed] == 255).all(axis=-1).mean() > 0.95  # beside the scene, but for edges
