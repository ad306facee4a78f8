"""Pictures: depth, colours, labels, shadows, cameras, files, and what a run draws of itself."""

import subprocess
import sys
from io import BytesIO
from itertools import combinations
from shutil import which

import clothsim as cs
import numpy as np
import pytest
from clothsim.run.result import greatest_depths
from clothsim.viewing import camera, raster
from clothsim.viewing.scale import make_scale, point_values
from colors import check_lines, distance
from commands import python

ABOVE = cs.Camera((0.0, 1.0, 0.0), (0.5, 0.0, 0.5), 1.1, 1.1)
FLAT = cs.Scene(cs.Cloth(pins=()))


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.scenes.paper_static(), 0.3, dt=5e-4, every=0.02)


def red(pixels):
    """Mark pixels that are at least half red; neither cloth nor sphere has r > g."""
    r, g, _ = np.moveaxis(np.asarray(pixels).astype(int), -1, 0)
    return r > g


def hue(pixel):
    """Return a colour without its brightness, since the light on the cloth changes that alone."""
    pixel = np.asarray(pixel, float)
    return pixel / pixel.sum(axis=-1, keepdims=True)


@pytest.mark.parametrize("depth", [0.002, 0.02])
def test_red_is_the_circle_in_which_a_plane_cuts_the_sphere(depth):
    scene = cs.Scene(cs.Cloth(pins=()), cs.Sphere((0.5, -0.25 + depth, 0.5)))
    pixels = cs.picture(scene, camera=ABOVE, width=440).pixels
    area = red(pixels).sum() * (1.1 / 440) ** 2
    assert area == pytest.approx(np.pi * (2 * 0.25 * depth - depth**2), rel=0.03)
    rows, columns = np.nonzero(red(pixels))
    assert (rows.mean(), columns.mean()) == pytest.approx((219.5, 219.5), abs=1)


@pytest.mark.parametrize("shape", [(32, 32), (2, 2)])
def test_depth_is_that_of_each_place_of_the_cloth(shape):
    """A level sheet that cuts a sphere: the depth at a distance from the axis, of whatever points
    the sheet has.
    """
    depth, radius = 0.04, 0.25
    scene = cs.Scene(cs.Cloth(shape, pins=()), cs.Sphere((0.5, -radius + depth, 0.5), radius))
    pixels = cs.picture(scene, camera=ABOVE, width=550, color="depth", ground=False).pixels / 255
    scale = make_scale("depth", np.array([depth]), None)
    assert scale.low == 0 and scale.high == depth and not scale.open_end
    for away in (0.005, 0.06, 0.1, 0.125):
        here = pixels[round(275 + 500 * away / 2**0.5), round(275 + 500 * away / 2**0.5)]
        expected = scale.colors(radius - np.hypot(away, radius - depth))
        assert here == pytest.approx(expected, abs=0.02)
    assert hue(pixels[400, 400]) == pytest.approx(hue(scale.colors(0.0)), abs=0.01)  # outside
    assert greatest_depths(scene.spheres, scene.initial_position[None], np.zeros(1))[
        "triangles"
    ] == pytest.approx([depth])


def test_cloth_a_tenth_of_a_millimetre_above_the_sphere_hides_it():
    cloth = cs.Cloth(pins=())
    for options in ({}, {"color": "depth"}):
        options |= {"camera": ABOVE, "width": 220, "ground": False}
        hidden = cs.picture(cs.Scene(cloth, cs.Sphere((0.5, -0.2501, 0.5))), **options)
        assert np.array_equal(hidden, cs.picture(cs.Scene(cloth), **options))


def test_a_moving_sphere_is_drawn_where_it_is_at_that_time():
    sphere = cs.Sphere((0.5, 0.5, 0.5), 0.1, cs.Linear((0.3, 0.0, 0.0)))
    scene = cs.Scene(cs.Cloth(pins=()), sphere)
    pixels = cs.picture(scene, t=1.0, camera=ABOVE, width=220, ground=False).pixels.astype(int)
    grey = np.abs(pixels[..., 0] - pixels[..., 2]) < 12
    grey &= (pixels < 250).all(axis=-1)
    rows, columns = np.nonzero(grey)
    # 0.5 m along z is the middle row; x = 0.8 m is 0.3 m right of the middle.
    assert (rows.mean(), columns.mean()) == pytest.approx((109.5, 109.5 + 0.3 * 200), abs=1)
    assert grey.sum() == pytest.approx(np.pi * 20**2, rel=0.05)
    moving = cs.scenes.paper_moving()
    with pytest.raises(ValueError, match="^t must be given where a sphere moves"):
        cs.picture(moving, moving.initial_position, width=32)
    assert np.array_equal(
        cs.picture(moving, moving.initial_position, 0.0, width=32), cs.picture(moving, width=32)
    )


def test_colours_are_distinct_for_any_colour_vision():
    colors = raster.CLOTH_FRONT, raster.CLOTH_BACK, raster.SPHERE, raster.PENETRATION
    assert (
        min(distance(a, b) for a, b in combinations(colors, 2)) > 20
    )  # 2.3 is a just noticeable difference
    inside, outside = (
        make_scale("depth", np.ones(1), None).colors(np.array(k)) for k in (1.0, 0.0)
    )
    assert (
        min(distance(a, b) for a, b in combinations((inside, outside, raster.DARK_SPHERE), 2)) > 20
    )
    assert min(distance(outside, grey) for grey in (raster.SPHERE, raster.GROUND)) > 20


@pytest.mark.parametrize("name", [*camera.DIRECTIONS, (0.2, -1.0, 0.4)], ids=str)
def test_a_direction_shows_cloth_and_spheres_whole(name):
    scene = cs.Scene(cs.Cloth(), [cs.Sphere((2.0, 1.0, 0.0), 0.4), cs.Sphere((0, -2, 0), 0.1)])
    pixels = cs.picture(scene, camera=name, width=150, ground=False).pixels
    frame = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (frame == 255).all()
    ink = (pixels < 250).any(axis=-1)
    rows, columns = np.nonzero(ink)
    assert ink.mean() > 0.02 and (
        np.ptp(columns) > 0.6 * 150 or np.ptp(rows) > 0.6 * pixels.shape[0]
    )


def test_a_row_without_a_surface_shows_its_points():
    cloth = cs.Cloth((1, 5), pins=((0, 0),))
    pixels = cs.picture(cs.Scene(cloth), camera="top", width=300).pixels
    blue = (pixels[..., 2] > pixels[..., 0].astype(int) + 30).any(axis=0)
    assert (np.diff(blue.astype(int)) == 1).sum() == 4
    assert (pixels < 60).all(axis=-1).any()


# Colours of values, and the label


def test_an_array_colours_each_mass_point_by_the_scale():
    values = np.add.outer(np.zeros(32), np.arange(32.0))
    pixels = cs.picture(FLAT, camera=ABOVE, width=550, color=values).pixels
    scale = make_scale(values, values, None)
    for column in (0.5, 10.5, 20.5, 30.5):  # between grid lines
        x = round(550 * (0.5 + (column / 31 - 0.5) / 1.1))
        assert hue(pixels[275 + 8, x]) == pytest.approx(
            hue(scale.colors(np.array(column))), abs=0.01
        )
    unknown = cs.picture(FLAT, camera=ABOVE, width=200, color=np.full((32, 32), np.nan)).pixels
    assert np.ptp(unknown[60:140, 60:140].astype(int), axis=-1).max() == 0


@pytest.mark.parametrize("name", ["stretch", "speed", "depth"])
def test_named_colours_follow_the_measure_on_one_scale(run, name):
    measure = {
        "stretch": lambda k: cs.largest_stretch(run.scene, run.x[k]),
        "speed": lambda k: np.linalg.norm(run.v[k], axis=-1).max(),
        "depth": lambda k: cs.penetration(run.x[k], run.scene.spheres[0])["triangles"],
    }[name]
    found = (
        run.penetration()["triangles"]
        if name == "depth"
        else point_values(name, run.scene, run.x, run.v)
    )
    for k in (0, 5, 10):
        assert found[k].max() == pytest.approx(measure(k), abs=1e-12)
    # The scale of a run is that of all its frames; a state alone has its own.
    scale = make_scale(name, found, None)
    own = cs.picture(run.scene, run.x[3], v=run.v[3], color=name, width=200).pixels
    same = run.picture(3, color=name, width=200, limits=(scale.low, scale.high)).pixels
    assert np.array_equal(run.picture(3, color=name, width=200).pixels, same)
    assert name == "depth" or not np.array_equal(own, same)


def test_a_label_is_a_strip_below_the_same_picture(run):
    pytest.importorskip("PIL")
    plain, labelled = (
        run.picture(4, width=400).pixels,
        run.picture(4, width=400, label=True, color="faces").pixels,
    )
    assert np.array_equal(labelled[: len(plain)], plain)
    strip = labelled[len(plain) :]
    assert (strip[[0, -1]] == 255).all() and (strip < 60).any()
    # A clock alone changes from frame to frame.
    other = run.picture(5, width=400, label=True).pixels[len(plain) :]
    columns = np.flatnonzero((strip != other).any(axis=(0, 2)))
    assert columns.size and columns.max() < 0.25 * 400
    # "as printed" has a line of its own above the other one.
    printed = cs.picture(
        cs.scenes.paper_static("ray", as_printed=True), width=400, label=True
    ).pixels
    more = len(printed) - len(
        cs.picture(cs.scenes.paper_static("ray"), width=400, label=True).pixels
    )
    note = printed[-len(strip) - more : -len(strip)]
    columns = np.flatnonzero((note < 150).any(axis=(0, 2)))
    assert more > 10 and 0.1 * 400 < np.ptp(columns) < 0.25 * 400 and (note[[0, -1]] == 255).all()


# Shadows and ground


def drawn(sheet, balls, view, width, planes):
    """Return the red of a picture without and with shadows."""
    both = (
        raster.render(sheet, balls, view, width, planes=planes, shadow=one) for one in (False, True)
    )
    return [one[..., 0].astype(int) for one in both]


def test_the_shadow_of_a_ball_lies_on_the_ground_away_from_the_light():
    """The light comes from (0.3, 1, 0.25): a ball 1 m above the ground shades the place 0.3 m and
    0.25 m beside it.
    """
    sheet = np.zeros((2, 2, 3)) + (0, -5, 0)  # below the ground
    ball = raster.Ball((0.0, 1.0, 0.0), 0.1, (0.5, 0.5, 0.5))
    view = cs.Camera((0, 1, 0), (0, 0, 0), 2.0, 2.0)
    lit, dark = drawn(sheet, [ball], view, 200, [raster.Plane((0, 0, 0), 4.0)])
    darker = lit - dark
    rows, columns = np.nonzero(darker > 20)
    assert (columns.mean() - 99.5) / 100 == pytest.approx(-0.3, abs=0.02)
    assert (rows.mean() - 99.5) / 100 == pytest.approx(-0.25, abs=0.02)
    assert len(np.unique(darker)) > 20  # soft
    assert (darker >= 0).all()


def test_a_ground_is_seen_from_above_alone_and_lies_under_all():
    scene = cs.scenes.paper_static()
    for name in ("corner", "below"):
        bare, plain = (
            cs.picture(scene, camera=name, width=100, ground=one).pixels for one in (False, True)
        )
        assert np.array_equal(bare.shape, plain.shape)
        beside = (bare == 255).all(axis=-1)
        assert ((plain[beside] < 250).any(axis=-1).mean() > 0.2) == (name == "corner")
        grey = plain[beside & (plain < 250).any(axis=-1)].astype(int)
        assert name == "below" or np.ptp(grey, axis=-1).max() < 5


def test_points_behind_the_eye_are_not_drawn():
    x, view = FLAT.initial_position, cs.Camera((0, 1, 0), (0.5, 0.0, 0.5), 1.2, 1.2, distance=2.0)
    behind = raster.Ball((0.5, 3.0, 0.5), 0.3, raster.SPHERE)
    assert np.array_equal(raster.render(x, [behind], view, 90), raster.render(x, [], view, 90))
    assert (raster.render(x + (0, 2.5, 0), [], view, 90) == 255).all()


@pytest.mark.parametrize("shadow", [False, True])
def test_pixels_are_the_same_for_every_number_of_threads(shadow, crumpled):
    x, ball = crumpled(shape=(7, 9)).x, raster.Ball((0.5, -0.1, 0.5), 0.35, raster.SPHERE)
    view, planes = cs.Camera.around((1.0, 0.6, 1.3), x), [raster.Plane((0.5, -0.8, 0.5), 1.0)]
    whole, *others = (
        raster.render(x, [ball], view, 301, planes=planes, shadow=shadow, threads=n)
        for n in (1, 2, 5)
    )
    assert all(np.array_equal(whole, one) for one in others)


# Files, runs and films


def test_picture_saves_shows_and_is_an_array(tmp_path):
    picture = cs.picture(cs.scenes.paper_static(), width=120, path=tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == picture._repr_png_()
    with pytest.raises(ValueError, match="read-only"):
        picture.pixels[0] = 0
    image = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(0).integers(0, 256, (37, 53, 3), np.uint8)
    for one in (picture, cs.Picture(pixels)):
        assert np.array_equal(np.array(image.open(BytesIO(one._repr_png_()))), np.asarray(one))
    picture.save(tmp_path / "a.webp")
    assert image.open(tmp_path / "a.webp").size == (120, picture.pixels.shape[0])


def test_run_draws_the_frame_asked_for(run, tmp_path):
    last = run.picture(width=150)
    assert np.array_equal(last, run.picture(frame=-1, width=150))
    assert np.array_equal(run.picture(t=0.101, width=150), run.picture(frame=5, width=150))
    assert not np.array_equal(last, run.picture(frame=0, width=150))
    assert last.pixels.shape == run.picture(frame=0, width=150).pixels.shape
    run.picture(path=tmp_path / "frame.png", width=150)
    assert (tmp_path / "frame.png").stat().st_size > 1000
    with pytest.raises(ValueError, match="frame must be an integer >= -16 and <= 15"):
        run.picture(frame=16)
    with pytest.raises(ValueError, match="frame must be None with t"):
        run.picture(frame=1, t=0.1)
    with pytest.raises(ValueError, match="t must be a finite number >= 0 and <= 0.3"):
        run.picture(t=1.0)


def test_plot_has_the_run_s_figures(run, tmp_path):
    pytest.importorskip("matplotlib")
    figure = run.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 20_000
    assert figure._repr_png_().startswith(b"\x89PNG")
    lines = {line.get_label(): line for axis in figure.axes for line in check_lines(axis)}
    assert len(figure.axes) == 4
    figure.draw_without_rendering()
    named = figure.axes[0].get_legend()
    assert named.get_window_extent().x0 > figure.axes[0].bbox.x1  # beside the lines
    energy = cs.energy(run.scene, run.x[7], run.v[7])
    for name in ("kinetic", "elastic", "gravity", "total"):
        assert lines[name].get_ydata()[7] == pytest.approx(energy[name], rel=1e-12)
    sphere = run.scene.spheres[0]
    depth = [1e3 * cs.penetration(x, sphere)["triangles"] for x in run.x]
    assert lines["deepest triangle"].get_ydata() == pytest.approx(depth)
    assert max(depth) > 0
    stretch = [100 * cs.largest_stretch(run.scene, x) for x in run.x]
    assert lines["stretch"].get_ydata() == pytest.approx(stretch)
    # At the start nothing touches; a flat sheet on the sphere touches where it is close enough.
    assert lines["contacts"].get_ydata()[0] == 0 and lines["contacts"].get_ydata()[-1] > 10
    plain = cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3)
    assert len(plain.plot().axes) == 2
    with pytest.raises(ValueError, match="^path must end in one of .*.png.*, got '.*a.xyz'"):
        plain.plot(tmp_path / "a.xyz")


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_film_holds_the_pictures_for_their_time(run, tmp_path, suffix):
    image = pytest.importorskip("PIL.Image")
    film = image.open(run.animate(tmp_path / f"a.{suffix}", fps=30, width=100))
    durations, pictures = [], []
    for k in range(film.n_frames):
        film.seek(k)
        film.load()
        durations.append(film.info["duration"])
        pictures.append(np.array(film.convert("RGB")).astype(int))
    assert film.n_frames == 10
    assert sum(durations) == pytest.approx(1000 * 10 / 30, abs=6)
    for k, frame in ((0, 0), (-1, -1)):
        difference = np.abs(pictures[k] - run.picture(frame, width=100).pixels)
        assert difference.mean() < 5
    assert np.abs(pictures[0] - pictures[-1]).mean() > 10


@pytest.mark.parametrize("program", ["ffmpeg", "imageio_ffmpeg"])
def test_mp4_film_by_the_program_or_the_package(run, tmp_path, monkeypatch, program):
    if program == "imageio_ffmpeg":
        ffmpeg = pytest.importorskip(program).get_ffmpeg_exe()
        monkeypatch.setenv("PATH", str(tmp_path))
    elif (ffmpeg := which("ffmpeg")) is None:
        pytest.skip("ffmpeg is not installed")
    path = run.animate(tmp_path / "a.mp4", fps=25, speed=0.5, width=161)
    command = [ffmpeg, "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    expected = run.picture(-1, width=160).pixels
    height = expected.shape[0] + expected.shape[0] % 2
    film = np.frombuffer(raw, np.uint8).reshape(-1, height, 160, 3)
    assert len(film) == 16  # 0.3 s at half speed, 25 a second
    assert np.abs(film[-1, : expected.shape[0]].astype(int) - expected).mean() < 6


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_memory_of_a_film_does_not_grow_with_its_pictures(suffix, tmp_path):
    pytest.importorskip("PIL.Image")
    code = f"""
import resource, clothsim as cs
run = cs.simulate(cs.scenes.paper_swing(), 0.2, dt=1e-3, every=0.005)
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
run.animate({str(tmp_path / "a")!r} + ".{suffix}", fps=20, speed=1, width=640)
before = peak()
run.animate({str(tmp_path / "b")!r} + ".{suffix}", fps=50, speed=0.1, width=640)
print(peak() - before)
"""
    grown = python(code)
    assert float(grown.stdout) < 40  # MB; 101 pictures of 640 x 500 take 97


def test_films_that_cannot_be(run, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"path must end in one of .gif, .webp, .mp4"):
        run.animate(tmp_path / "a.avi")
    with pytest.raises(ValueError, match="fps must be a finite number > 0 and <= 50"):
        run.animate(tmp_path / "a.gif", fps=60)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        RuntimeError, match=r"needs ffmpeg, .*imageio-ffmpeg.*ffmpeg.*'clothsim\[film\]'.*webp"
    ):
        run.animate(tmp_path / "a.mp4", width=64)
    short = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    with pytest.raises(ValueError, match="at least 3 stored frames, this run has 2.*every="):
        short.animate(tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())
