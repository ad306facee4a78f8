"""Pictures: depth, colours, cameras, files, and what a run draws of itself."""

import subprocess
import sys
from io import BytesIO
from itertools import combinations
from shutil import which

import clothsim as cs
import numpy as np
import pytest
from clothsim.viewing import camera, raster
from clothsim.viewing.animation import shown_frames
from colors import distance
from commands import python

ABOVE = cs.Camera((0.0, 1.0, 0.0), (0.5, 0.0, 0.5), 1.1, 1.1)


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.scenes.paper_static(), 0.3, dt=5e-4, every=0.02)


def red(pixels):
    """Pixels of which red covers at least half; neither the cloth's front nor the sphere has r > g."""
    r, g, _ = np.moveaxis(np.asarray(pixels).astype(int), -1, 0)
    return r > g


@pytest.mark.parametrize("depth", [0.002, 0.02])
def test_red_is_the_circle_in_which_a_plane_cuts_the_sphere(depth):
    scene = cs.Scene(cs.Cloth(pins=()), cs.Sphere((0.5, -0.25 + depth, 0.5)))
    pixels = cs.picture(scene, camera=ABOVE, width=440).pixels
    area = red(pixels).sum() * (1.1 / 440) ** 2
    assert area == pytest.approx(np.pi * (2 * 0.25 * depth - depth**2), rel=0.03)
    rows, columns = np.nonzero(red(pixels))
    assert (rows.mean(), columns.mean()) == pytest.approx((219.5, 219.5), abs=1)


def test_cloth_a_tenth_of_a_millimetre_above_the_sphere_hides_it():
    cloth = cs.Cloth(pins=())
    hidden = cs.picture(cs.Scene(cloth, cs.Sphere((0.5, -0.2501, 0.5))), camera=ABOVE, width=220)
    bare = cs.picture(cs.Scene(cloth), camera=ABOVE, width=220)
    assert np.array_equal(hidden, bare)


def test_a_moving_sphere_is_drawn_where_it_is_at_that_time():
    sphere = cs.Sphere((0.5, 0.5, 0.5), 0.1, cs.Linear((0.3, 0.0, 0.0)))
    scene = cs.Scene(cs.Cloth(pins=()), sphere)
    pixels = cs.picture(scene, t=1.0, camera=ABOVE, width=220).pixels.astype(int)
    grey = np.abs(pixels[..., 0] - pixels[..., 2]) < 12
    grey &= (pixels < 250).all(axis=-1)
    rows, columns = np.nonzero(grey)
    # 0.5 m along z is the middle row; x = 0.8 m is 0.3 m right of the middle.
    assert (rows.mean(), columns.mean()) == pytest.approx((109.5, 109.5 + 0.3 * 200), abs=1)
    assert grey.sum() == pytest.approx(np.pi * 20**2, rel=0.05)


def test_colours_are_distinct_for_any_colour_vision():
    colors = raster.CLOTH_FRONT, raster.CLOTH_BACK, raster.SPHERE, raster.PENETRATION
    assert min(distance(a, b) for a, b in combinations(colors, 2)) > 20  # 2.3 is a just noticeable difference


@pytest.mark.parametrize("perspective, part", [(False, 0.85), (True, 0.6)])
@pytest.mark.parametrize("name", [*camera.DIRECTIONS, (0.2, -1.0, 0.4)], ids=str)
def test_a_direction_shows_cloth_and_spheres_whole(name, perspective, part):
    scene = cs.Scene(cs.Cloth(), [cs.Sphere((2.0, 1.0, 0.0), 0.4), cs.Sphere((0, -2, 0), 0.1)])
    pixels = cs.picture(scene, camera=name, width=150, perspective=perspective).pixels
    frame = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (frame == 255).all()
    ink = (pixels < 250).any(axis=-1)
    rows, columns = np.nonzero(ink)
    assert ink.mean() > 0.02 and (np.ptp(columns) > part * 150 or np.ptp(rows) > part * pixels.shape[0])


def test_a_row_without_a_surface_shows_its_points():
    cloth = cs.Cloth((1, 5), pins=((0, 0),))
    pixels = cs.picture(cs.Scene(cloth), camera="top", width=300).pixels
    blue = (pixels[..., 2] > pixels[..., 0].astype(int) + 30).any(axis=0)
    assert (np.diff(blue.astype(int)) == 1).sum() == 4
    assert (pixels < 60).all(axis=-1).any()


def test_png_is_read_back_bit_for_bit():
    image = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(0).integers(0, 256, (37, 53, 3), np.uint8)
    pixels[5:20] = pixels[5]  # rows that each filter suits
    pixels[20:30, :, 0] = np.arange(53)
    assert np.array_equal(np.array(image.open(BytesIO(cs.Picture(pixels)._repr_png_()))), pixels)


def test_picture_saves_shows_and_is_an_array(tmp_path):
    picture = cs.picture(cs.scenes.paper_static(), width=120, path=tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == picture._repr_png_()
    image = pytest.importorskip("PIL.Image")
    assert np.array_equal(np.array(image.open(tmp_path / "a.png")), np.asarray(picture))
    picture.save(tmp_path / "a.webp")
    assert image.open(tmp_path / "a.webp").size == (120, picture.pixels.shape[0])
    with pytest.raises(ValueError, match="read-only"):
        picture.pixels[0] = 0


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"camera": "fornt"}, ValueError, "did you mean 'front'"),
        ({"camera": (0, 0, 0)}, ValueError, "not all 0"),
        ({"camera": 3}, ValueError, "camera must be"),
        ({"x": np.zeros((3, 3, 3))}, ValueError, r"x must be an array of shape \(32, 32, 3\)"),
        ({"x": np.full((32, 32, 3), np.nan)}, ValueError, "nan at index"),
        ({"path": "a.xyz"}, ValueError, "^path must end in .png or in another suffix"),
        ({"scene": "paper_static"}, TypeError, "scene must be a Scene"),
        ({"scene": np.zeros((4, 5, 3))}, TypeError, "^scene must be a Scene, got an array of shape"),
        ({"color": "strech"}, ValueError, "did you mean 'stretch'"),
        ({"color": np.zeros((3, 3))}, ValueError, r"color must be one of .*numbers of shape \(32, 32\).*\(3, 3\)"),
        ({"color": "speed"}, ValueError, 'v must be given with color="speed"'),
        ({"color": None}, ValueError, "color must be one of"),
        ({"limits": (0, 1)}, ValueError, 'limits must be None with color="faces"'),
        ({"color": "stretch", "limits": (1, 1)}, ValueError, "limits must be two rising numbers"),
        ({"color": "stretch", "limits": 3}, (ValueError, TypeError), "limits must be"),
        ({"label": True, "width": 100}, ValueError, "width must be at least 320 with label=True"),
        ({"ground": "low"}, (ValueError, TypeError), "ground must be"),
        ({"ground": np.nan}, ValueError, "ground must be"),
        ({"perspective": True, "camera": ABOVE}, ValueError, "perspective must be False with a Camera"),
        ({"v": np.zeros(3)}, ValueError, r"v must be an array of shape \(32, 32, 3\)"),
    ],
)
def test_bad_arguments_are_named(arguments, error, words):
    with pytest.raises(error, match=words):
        cs.picture(**{"scene": cs.scenes.paper_static(), **arguments})


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
    lines = {line.get_label(): line for axis in figure.axes for line in axis.get_lines()}
    assert len(figure.axes) == 4
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


def test_contacts_are_the_points_within_the_contact_radius():
    from clothsim.viewing.plots import touching

    cloth = cs.Cloth((11, 11), pins=())  # spacing 0.1 m: near is 3.125 mm
    sphere = cs.Sphere((0.5, -0.25, 0.5), 0.25, offset="none", response="ray")
    assert touching(cs.Scene(cloth, sphere), cloth.rest_positions, 0.0) == 1
    assert touching(cs.Scene(cloth, sphere), cloth.rest_positions + (0, 0.003, 0), 0.0) == 1
    higher = cloth.rest_positions + (0, 0.0032, 0)
    assert touching(cs.Scene(cloth, sphere), higher, 0.0) == 0
    away = sphere.replace(motion=cs.Linear((0.0, 1.0, 0.0)))  # at 0.2 s it cuts a circle of 0.245 m
    assert touching(cs.Scene(cloth, away), cloth.rest_positions, 0.2) == 21


def test_films_follow_the_clock():
    t = np.array([0.0, 0.1, 0.2, 0.3, 1.0])
    assert shown_frames(t, 10, 1.0) == [0, 1, 2, 3, 3, 3, 3, 4, 4, 4, 4]
    assert shown_frames(t, 10, 2.0) == [0, 2, 3, 3, 4, 4]
    assert shown_frames(t + 5.0, 5, 1.0) == [0, 2, 3, 3, 4, 4]


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


def test_mp4_film(run, tmp_path):
    if which("ffmpeg") is None:
        pytest.skip("ffmpeg is not installed")
    path = run.animate(tmp_path / "a.mp4", fps=25, speed=0.5, width=161)
    command = ["ffmpeg", "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    expected = run.picture(-1, width=160).pixels
    height = expected.shape[0] + expected.shape[0] % 2
    film = np.frombuffer(raw, np.uint8).reshape(-1, height, 160, 3)
    assert len(film) == 16  # 0.3 s at half speed, 25 a second
    assert np.abs(film[-1, : expected.shape[0]].astype(int) - expected).mean() < 6


def test_mp4_film_by_the_package_where_no_program_is(run, tmp_path, monkeypatch):
    package = pytest.importorskip("imageio_ffmpeg")
    monkeypatch.setenv("PATH", str(tmp_path))
    used = []
    found = package.get_ffmpeg_exe()
    monkeypatch.setattr(package, "get_ffmpeg_exe", lambda: used.append(found) or found)
    assert run.animate(tmp_path / "a.mp4", width=64).stat().st_size > 1000
    assert used


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_memory_of_a_film_does_not_grow_with_its_pictures(suffix, tmp_path):
    pytest.importorskip("PIL.Image")
    code = f"""
import resource, clothsim as cs
run = cs.simulate(cs.scenes.paper_swing(), 0.2, dt=1e-3, every=0.005)
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
run.animate({str(tmp_path / "a")!r} + ".{suffix}", fps=20, speed=1, width=800)
before = peak()
run.animate({str(tmp_path / "b")!r} + ".{suffix}", fps=50, speed=0.05, width=800)
print(peak() - before)
"""
    grown = python(code)
    assert float(grown.stdout) < 60  # MB; 201 pictures of 800 x 600 take 290


def test_films_that_cannot_be(run, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"path must end in one of .gif, .webp, .mp4"):
        run.animate(tmp_path / "a.avi")
    with pytest.raises(ValueError, match="fps must be a finite number > 0 and <= 50"):
        run.animate(tmp_path / "a.gif", fps=60)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RuntimeError, match=r"needs ffmpeg, .*imageio-ffmpeg.*ffmpeg.*'clothsim\[film\]'.*webp"):
        run.animate(tmp_path / "a.mp4", width=64)
    short = cs.simulate(cs.scenes.oscillator(), 0.01, dt=1e-3)
    with pytest.raises(ValueError, match="at least 3 stored frames, this run has 2.*every="):
        short.animate(tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


def test_a_picture_of_a_moving_sphere_needs_the_time_of_its_positions():
    scene = cs.scenes.paper_moving()
    with pytest.raises(ValueError, match="^t must be given where a sphere moves"):
        cs.picture(scene, scene.initial_position, width=32)
    first = cs.picture(scene, width=32).pixels
    assert (cs.picture(scene, scene.initial_position, 0.0, width=32).pixels == first).all()
