"""Planes to the eye, in pictures and on pages: a grid of 10 cm lines, shadows, and an outline from
behind.
"""

import clothsim as cs
import numpy as np
import pytest
from clothsim.run.result import Run
from pages import pixels, seek

HEIGHT = 1.2  # m of the cloth above the plane
CROSSING = (0.03, -HEIGHT, 0.02)  # m, a crossing of lines
SMALL = cs.Cloth((6, 6), size=(0.3, 0.3), pins=())
TO_LIGHT = np.array([0.3, 1.0, 0.25])


def lines(profile, places):
    """Return the places of the lines in a profile of brightness: darker or lighter than the
    rest.
    """
    away = np.abs(profile - np.median(profile))
    marked = away > 0.5 * away.max()
    starts = np.flatnonzero(np.diff(marked.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(marked.astype(int), append=0) == -1)
    weighted = [
        np.average(places[a : b + 1], weights=away[a : b + 1])
        for a, b in zip(starts, ends, strict=True)
    ]
    return np.array(weighted)


def assert_lines(profile, places, crossing):
    """Assert a line at every 10 cm from `crossing`, and no other, within 3 mm."""
    low, high = places.min() + 0.01, places.max() - 0.01
    expected = crossing + 0.1 * np.arange(-50, 51)
    expected = expected[(expected > low) & (expected < high)]
    seen = lines(profile, places)
    seen = seen[(seen > low) & (seen < high)]
    assert len(expected) >= 4 and seen == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize(
    "direction, normal, across, down",
    [
        ((0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 1), (0, 0, 1), (1, 0, 0), (0, -1, 0)),
        ((1, 0, 0), (1, 0, 0), (0, 0, -1), (0, -1, 0)),
    ],
    ids=["floor", "wall z", "wall x"],
)
def test_planes_of_pictures_have_lines_every_10_cm(direction, normal, across, down):
    node = -HEIGHT * np.array(normal) + (0.03, 0.04, 0.02) * (1 - np.array(normal))
    scene = cs.Scene(SMALL, cs.Plane(node, normal))
    view = cs.Camera(direction, (0.0, 0.0, 0.0), 1.4, 1.4)
    drawn = cs.picture(scene, camera=view, width=700, ground=False).pixels.astype(float)
    places = (np.arange(700) + 0.5) * 0.002 - 0.7
    corner = drawn[:300, :300].mean(axis=-1)  # where there is no cloth
    assert_lines(corner.mean(axis=0), places[:300], node @ across)
    assert_lines(corner.mean(axis=1), places[:300], node @ down)


def test_a_ground_that_no_scene_has_shows_no_grid():
    view = cs.Camera((0, 1, 0), (0.0, 0.0, 0.0), 1.4, 1.4)
    drawn = cs.picture(cs.Scene(SMALL), camera=view, width=300).pixels.astype(int)
    rows = drawn[:60, :60].sum(axis=-1)
    assert rows.max() - rows.min() < 60 and np.abs(np.diff(rows, axis=1)).max() < 8


@pytest.fixture
def falling(tmp_path):
    """Return `falling(speed)`: a page of a small sheet high above a floor, and 1 s later near it.
    The floor moves along x [m/s].
    """

    def page(speed):
        floor = cs.Plane(CROSSING, motion=cs.Linear((speed, 0.0, 0.0)))
        x = np.stack([SMALL.rest_positions, SMALL.rest_positions - (0.0, HEIGHT - 0.01, 0.0)])
        run = Run(cs.Scene(SMALL, floor), np.array([0.0, 1.0]), x, np.zeros_like(x), {})
        return run.to_html(tmp_path / "falling.html")

    return page


def from_above(page):
    """Return the brightness seen from above, and the x and z of its columns and rows [m]."""
    page.tab.evaluate("() => { page.camera.reset([0, 1, 0]); page.redraw(); }")
    shown = pixels(page).mean(axis=-1)
    rows, columns = shown.shape
    target = page.tab.evaluate("page.camera.target")
    width, height = page.tab.evaluate("(aspect) => page.camera.extent(aspect)", columns / rows)
    x = target[0] + width * (2 * (np.arange(columns) + 0.5) / columns - 1)
    z = target[2] + height * (2 * (np.arange(rows) + 0.5) / rows - 1)
    return shown, x, z


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_floor_of_a_page_has_lines_every_10_cm_that_move_with_it(falling, opened, scheme):
    page = opened(falling(0.04), color_scheme=scheme)
    page.ready()
    for frame, moved in enumerate((0.0, 0.04)):
        seek(page, frame)
        shown, x, z = from_above(page)
        part = shown[(z > 0.32) & (z < 0.6)][:, (x > 0.32) & (x < 0.9)]  # beside cloth and shadow
        assert_lines(part.mean(axis=0), x[(x > 0.32) & (x < 0.9)], CROSSING[0] + moved)
        beside = shown[:, (x > 0.32) & (x < 0.9)]
        assert_lines(beside[(z > -0.3) & (z < 0.6)].mean(axis=1), z[(z > -0.3) & (z < 0.6)], 0.02)
    assert page.said == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_shadow_of_the_cloth_lies_on_the_floor_away_from_the_light(falling, opened, scheme):
    page = opened(falling(0.0), color_scheme=scheme)
    page.ready()
    seen = []
    for frame in (0, 1):  # the shadow lies beside the cloth, then below it
        seek(page, frame)
        shown, x, z = from_above(page)
        seen.append(shown[z < -0.03][:, x < -0.03])
    x = x[x < -0.03]
    z = z[z < -0.03]
    middle = 0.15 - HEIGHT * TO_LIGHT[[0, 2]]
    part = 1 - seen[0] / seen[1]
    rows, columns = np.nonzero(part > 0.1)
    assert len(rows) and (x[columns].mean(), z[rows].mean()) == pytest.approx(middle, abs=0.02)
    assert 0.15 < part[np.abs(z - middle[1]).argmin(), np.abs(x - middle[0]).argmin()] < 0.35
    assert part.min() > -0.02


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_plane_is_a_surface_from_the_front_and_an_outline_from_behind(tmp_path, opened, scheme):
    x = np.stack(2 * [SMALL.rest_positions])
    wall = cs.Plane((-0.02, 0.0, 0.0), (1.0, 0.0, 0.0))
    run = Run(cs.Scene(SMALL, wall), np.array([0.0, 1.0]), x, np.zeros_like(x), {})
    page = opened(run.to_html(tmp_path / "wall.html"), color_scheme=scheme)
    page.ready()
    share = {}
    for name, eye in (("front", [1, 0.4, 0.8]), ("behind", [-1, 0.4, 0.8]), ("beside", [0, 0, 1])):
        page.tab.evaluate("(eye) => { page.camera.reset(eye); page.redraw(); }", eye)
        shown = pixels(page).astype(int)
        share[name] = (np.abs(shown - page_color(page)).max(axis=-1) > 4).mean()
        share[f"{name}, cloth"] = (np.ptp(shown, axis=-1) > 25).mean()
    assert share["front"] > share["front, cloth"] + 0.4
    for name in ("behind", "beside"):
        assert 0.002 < share[name] - share[f"{name}, cloth"] < 0.05, share


def page_color(page):
    """Return the background of the page."""
    text = page.tab.evaluate("getComputedStyle(document.body).backgroundColor")
    return np.array([int(part) for part in text[4:-1].split(",")])


def test_cloth_below_a_plane_of_a_page_is_red(tmp_path, opened):
    x = np.stack([SMALL.rest_positions, SMALL.rest_positions - (0.0, 0.02, 0.0)])
    floor = cs.Plane((0.0, -0.01, 0.0))
    run = Run(cs.Scene(SMALL, floor), np.array([0.0, 1.0]), x, np.zeros_like(x), {})
    page = opened(run.to_html(tmp_path / "below.html"))
    page.ready()
    red = []
    for frame in (0, 1):
        seek(page, frame)
        shown = pixels(page).astype(int)
        red.append((shown[..., 0] > shown[..., 2] + 60).mean())
    assert red[0] == 0 and red[1] > 0.1
