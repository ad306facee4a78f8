"""Pages that play runs, in headless Chromium; `make test-view` runs those marked slow too."""

import zlib

import clothsim as cs
import numpy as np
import pytest
from clothsim.run.result import Run
from clothsim.viewing.page import pack_frames
from pages import frames, pixels, seek

FRAMES = 300


@pytest.fixture(scope="module")
def runs():
    """Return methods 1 and 2; the second with fewer frames, and shorter."""
    first = cs.simulate(cs.scenes.paper_static("reflect"), 1.5, dt=5e-4, every=1.5 / (FRAMES - 1))
    second = cs.simulate(cs.scenes.paper_static("ray"), 1.0, dt=5e-4, every=0.02)
    return {"method 1": first, "method 2": second}


@pytest.fixture(scope="module")
def alone(runs, tmp_path_factory):
    return runs["method 1"].to_html(tmp_path_factory.mktemp("page") / "one.html")


@pytest.fixture(scope="module")
def both(runs, tmp_path_factory):
    return cs.compare(runs).to_html(tmp_path_factory.mktemp("page") / "two.html")


def test_a_page_is_small_silent_and_asks_for_nothing(alone, opened):
    page = opened(alone)
    page.ready()
    page.tab.wait_for_timeout(100)
    assert page.said == [] and page.asked == [alone.as_uri()] and alone.stat().st_size < 3_000_000
    assert page.tab.title() == "paper_static, reflect"


def test_the_page_has_the_colours_and_lights_of_pictures(alone, runs, opened):
    page, run = opened(alone), runs["method 1"]
    page.ready()
    seen = {"page": [], "picture": []}
    # A flat sheet, whose face has one colour, and a sphere; then cloth inside the sphere.
    for frame in (0, int(run.penetration()["triangles"].argmax())):
        seek(page, frame)
        page.tab.wait_for_timeout(100)
        for name, drawn in (
            ("page", pixels(page)),
            ("picture", run.picture(frame, ground=False).pixels),
        ):
            colours = drawn.reshape(-1, 3).astype(int)
            red, green, blue = colours.T
            if frame == 0:
                ball = colours[(abs(blue - red) < 12) & (blue > 60) & (blue < 240)]
                seen[name] += [
                    np.median(colours[blue > red + 40], axis=0),
                    *np.quantile(ball, (0.5, 0.9), axis=0),
                ]
            else:
                seen[name] += [np.median(colours[red > green + 60], axis=0)]
    assert np.abs(np.array(seen["page"]) - seen["picture"]).max() <= 6, seen


def test_packed_values_are_right_where_differences_overflow():
    """Noise is the worst case of second differences modulo 65536."""
    rng = np.random.default_rng(2)
    x = rng.uniform(-1, 3, (5, 2, 3, 3))
    values = rng.uniform(0, 2, (5, 6))
    packed = pack_frames(x, [values], [1.0])
    data = np.frombuffer(zlib.decompress(packed.data), np.uint8).astype(int)
    count = x.size
    z = data[:count] + 256 * data[count : 2 * count]
    d = ((z >> 1) ^ -(z & 1)).reshape(5, -1)
    q = d.copy()
    q[1] += q[0]
    for k in (2, 3, 4):
        q[k] += 2 * q[k - 1] - q[k - 2]
    q = (q % 65536).reshape(5, 3, 6).transpose(0, 2, 1).reshape(x.shape)
    assert np.abs(packed.low + packed.step * q - x).max() <= packed.precision * 1.0001
    assert pack_frames(x * (1, 0, 1), [], []).precision <= packed.precision  # a flat sheet
    levels = np.cumsum(data[2 * count :].reshape(5, 6), axis=0) % 256
    assert np.abs(levels / 255 - np.sqrt(values.clip(0, 1))).max() < 0.5001 / 255


@pytest.mark.slow
def test_colours_follow_the_mode(alone, runs, opened):
    page = opened(alone)
    page.ready()
    seek(page, 90)
    shown = {}
    for mode in ("faces", "stretch", "speed", "depth"):
        page.tab.select_option("#mode", mode)
        shown[mode] = pixels(page)
    modes = list(shown)
    for k, one in enumerate(modes):
        for other in modes[k + 1 :]:
            assert (shown[one] != shown[other]).any(axis=-1).mean() > 0.02, (one, other)
    assert page.tab.inner_text("#high").endswith("mm")
    page.tab.select_option("#mode", "speed")
    speeds = np.linalg.norm(runs["method 1"].v, axis=-1)
    sign, number, unit = page.tab.inner_text("#high").split()
    assert float(number) == pytest.approx(np.quantile(speeds, 0.99), rel=0.06) and (sign, unit) == (
        "≥",
        "m/s",
    )
    page.tab.select_option("#mode", "faces")
    assert np.array_equal(pixels(page), shown["faces"])
    assert page.said == []


@pytest.mark.slow
def test_red_on_the_page_is_the_circle_in_which_a_plane_cuts_the_sphere(tmp_path, opened):
    """The page's own drawing against geometry: a sphere that rises through a level cloth."""
    cloth = cs.Cloth(pins=())
    scene = cs.Scene(
        cloth,
        cs.Sphere(
            (0.5, -0.25, 0.5), 0.25, cs.Linear((0.0, 1.0, 0.0)), response="ray", offset="edge"
        ),
    )
    t = np.array([0.0, 0.002, 0.02])
    x = np.broadcast_to(cloth.rest_positions, (3, 32, 32, 3)).copy()
    page = opened(Run(scene, t, x, np.zeros_like(x), {}).to_html(tmp_path / "cut.html"))
    page.ready()
    page.tab.click("button:text-is('top')")
    for k, depth in enumerate(t):
        seek(page, k)
        shown = pixels(page).astype(int)
        red = (shown[..., 0] > shown[..., 1] + 30) & (shown[..., 0] > shown[..., 2] + 30)
        extent = page.tab.evaluate("(a) => page.camera.extent(a)", shown.shape[1] / shown.shape[0])
        size = 2 * extent[1] / shown.shape[0]
        assert red.sum() * size**2 == pytest.approx(
            np.pi * (0.5 * depth - depth**2), rel=0.04, abs=1e-5
        )


@pytest.mark.parametrize("mass", [1.0, 1e6, 1e9, 1e-5])
def test_numbers_beside_a_curve_have_room_for_their_sign(tmp_path, opened, mass):
    cloth = cs.Cloth((2, 2), mass=mass, stiffness=1e3 * mass, damping=0.0, pins=())
    page = opened(cs.simulate(cs.Scene(cloth), 0.2, dt=1e-3, fps=50).to_html(tmp_path / "run.html"))
    page.ready()
    beside = page.tab.evaluate("""() => {
      const found = [], draw = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
        if (this.textAlign === "right") found.push([text, x - this.measureText(text).width]);
        draw.call(this, text, x, y);
      };
      page.curves.draw();
      return found;
    }""")
    assert any(float(text) < 0 for text, _ in beside) and min(left for _, left in beside) >= 1


SIDES = [(sign, axis) for axis in range(3) for sign in (1, -1)]
CORNER = (1.0, 0.6, 1.3)
BELOW = (0.3, -1.0, 0.5)


def test_planes_around_a_cloth_and_a_ball_before_the_eye_hide_no_more_than_a_line_of_it(
    tmp_path, opened
):
    cloth = cs.Cloth((8, 8), pins=())
    middle, normals = np.array([0.5, 0.0, 0.5]), [sign * np.eye(3)[axis] for sign, axis in SIDES]
    planes = [cs.Plane(middle - 0.8 * normal, normal) for normal in normals]
    ball = cs.Sphere(middle + 6.0 * np.array(CORNER) / np.linalg.norm(CORNER), 0.3)
    x = np.stack(2 * [cloth.rest_positions])
    t = np.array([0.0, 1.0])
    runs = {
        f"{k}": Run(cs.Scene(cloth, obstacles), t, x, np.zeros_like(x), {})
        for k, obstacles in enumerate([(), ball, *planes])
    }
    page = opened(cs.compare(runs).to_html(tmp_path / "sides.html"))
    page.ready()
    for eye in (CORNER, BELOW):
        turn = "(eye) => { page.camera.reset(eye); page.redraw(); }"
        page.tab.evaluate(turn, list(eye))
        bare, before, *behind = (pixels(page, k).astype(int) for k in range(8))
        seen = np.ptp(bare, axis=-1) > 25
        assert seen.mean() > 0.1
        assert np.array_equal(before, bare)
        for normal, shown in zip(normals, behind, strict=True):
            changed = (shown != bare).any(axis=-1)
            if normal @ eye > 0:
                assert changed.mean() > 0.2 and not changed[seen].any(), (eye, normal)
            else:
                assert 0 < changed.mean() < 0.06 and changed[seen].mean() < 0.06, (eye, normal)
    page.tab.select_option("#mode", "depth")
    label = page.tab.locator("#mode option[value=depth]").inner_text()
    assert label == "depth below a sphere or plane"
    assert page.tab.get_attribute("#canvas-2", "aria-label").startswith("Cloth and planes of 2.")


@pytest.mark.slow
def test_without_scripts_or_webgl_the_picture_stays(alone, opened, tmp_path):
    still = opened(alone, java_script_enabled=False)
    image = still.tab.locator(".stage img")
    assert image.is_visible() and image.bounding_box()["height"] > 200
    text = alone.read_text().replace('"webgl2"', '"no-such-context"')
    (tmp_path / "no.html").write_text(text)
    page = opened(tmp_path / "no.html")
    page.tab.wait_for_selector("#problem:not([hidden])")
    assert "needs WebGL 2" in page.tab.inner_text("#problem")
    assert page.tab.locator(".stage img").is_visible()


@pytest.mark.slow
def test_labels_are_text_whatever_they_hold(tmp_path, opened):
    run = cs.simulate(cs.scenes.oscillator(), 0.1, dt=1e-3, every=10)
    label = '</script><script>alert(1)</script> & "<b>'
    page = opened(cs.compare({label: run, "ü": run}).to_html(tmp_path / "page.html", title="<i>&"))
    page.ready()
    assert label in page.tab.inner_text("#runs")
    assert page.tab.title() == page.tab.inner_text("h1") == "<i>&"
    assert page.tab.locator("#curves canvas").count() == 2  # no sphere: energy and stretch
    assert page.tab.locator("#mode option").all_inner_texts() == ["faces", "stretch", "speed"]
    assert page.said == []


def test_runs_play_in_step_by_the_clock_and_end_on_their_last_frames(both, runs, opened):
    page = opened(both)
    page.ready()
    assert frames(page) == [299, 50]
    for k in (0, 57, 150, 250):
        seek(page, k)
        t = runs["method 1"].t[k]
        assert frames(page) == [
            int(np.searchsorted(run.t, t + 1e-9, side="right")) - 1 for run in runs.values()
        ]
        assert f"frame {k} of 299, t = {t:.4f} s" in page.tab.inner_text("#runs")
    page.tab.select_option("#speed", "0.015625")  # so slow that no load brings it to the end
    seek(page, 0)
    page.tab.click("#play")
    read = (
        "() => new Promise((d) => requestAnimationFrame(() => d([page.state.lastTick, "
        "page.state.t])))"
    )
    wall0, t0 = page.tab.evaluate(read)
    page.tab.wait_for_timeout(700)
    wall1, t1 = page.tab.evaluate(read)
    assert wall1 - wall0 > 500
    assert t1 - t0 == pytest.approx((wall1 - wall0) / 64_000, abs=1e-4)
    page.tab.evaluate("page.pause()")
    paused = page.tab.evaluate("page.state.t")
    page.tab.wait_for_timeout(150)
    assert page.tab.evaluate("page.state.t") == paused
    page.tab.uncheck("#loop")
    page.tab.select_option("#speed", "4")
    seek(page, 280)
    page.tab.click("#play")
    page.tab.wait_for_function("() => !page.state.playing")
    assert frames(page) == [299, 50] and page.tab.inner_text("#play") == "▶" and page.said == []


# The probe, and the difference of runs


@pytest.fixture(scope="module")
def pair():
    scenes = {name: cs.scenes.paper_static(name) for name in ("reflect", "ray")}
    return {name: cs.simulate(scene, 0.5, dt=1e-3, fps=20) for name, scene in scenes.items()}


@pytest.fixture(scope="module")
def compared(pair, tmp_path_factory):
    return cs.compare(pair, difference=True).to_html(tmp_path_factory.mktemp("page") / "both.html")


def test_a_probe_shows_values_and_curves_of_a_point_and_a_difference_its_own(
    compared, pair, opened
):
    page = opened(compared)
    page.ready()
    charts = page.tab.locator("#curves canvas").count()
    seek(page, 8)
    page.tab.fill("#row", "31")
    page.tab.fill("#column", "5")
    page.tab.press("#column", "Enter")
    found = cs.difference(*pair.values())["distance"]
    for k, run in enumerate(pair.values()):
        at = run.at(31, 5)
        said = page.tab.inner_text(f"#says-{k}")
        assert "row 31, column 5" in said
        numbers = [float(part.split()[-2]) for part in said.split(": ")[1].split(", ")]
        expected = [100 * at["stretch"][8], at["speed"][8], 1000 * found[8, 31, 5] * k]
        # 255 levels of the square root of the highest value
        highest = page.tab.evaluate("page.runs[0].highest")
        for value, right, name, factor in zip(
            numbers, expected, ("stretch", "speed", "difference"), (100, 1, 1000)
        ):
            top = factor * highest[name]
            assert (
                abs(value - right)
                <= 0.01 * right + 2 * np.sqrt(right * top) * 0.51 / 255 + 1e-3 * top
            )
    assert page.tab.locator("#curves canvas").count() == charts + 3
    page.tab.select_option("#mode", label="difference to reflect")
    shades = [len(np.unique(pixels(page, k).reshape(-1, 3), axis=0)) for k in (0, 1)]
    label = page.tab.locator("#curves canvas").nth(charts - 1).get_attribute("aria-label")
    assert shades[1] > shades[0] and label.startswith(
        "rms difference to the first run [mm]. ray: first 0 at 0 s, last "
    )
    rms = cs.difference(*pair.values())["rms"][-1]
    assert float(label.split("last ")[1].split()[0]) == pytest.approx(1000 * rms, rel=6e-3)
    page.tab.fill("#row", "")
    page.tab.fill("#column", "")
    page.tab.press("#column", "Enter")
    assert page.tab.locator("#curves canvas").count() == charts and page.said == []


def test_a_click_probes_the_point_below_it_and_a_drag_does_not(compared, pair, opened):
    page = opened(compared)
    page.ready()
    page.tab.click("button:text-is('top')")
    seek(page, 0)
    script = "(c) => page.camera.projection(c)(page.runs[1].positions(0), 3 * 330)"
    x, y, _ = page.tab.locator("#canvas-1").evaluate(script)
    page.tab.locator("#canvas-1").click(position={"x": x, "y": y})
    assert page.tab.evaluate("page.state.probe") == [10, 10]
    assert page.tab.locator(".ring:visible").count() == 2
    box = page.tab.locator("#canvas-1").bounding_box()
    page.tab.mouse.move(box["x"] + x + 60, box["y"] + y)
    page.tab.mouse.down()
    page.tab.mouse.move(box["x"] + x + 90, box["y"] + y + 9, steps=3)
    page.tab.mouse.up()
    assert page.tab.evaluate("page.state.probe") == [10, 10]
    page.tab.locator("#canvas-1").click(position={"x": 3, "y": 3})
    assert (
        page.tab.evaluate("page.state.probe") is None
        and page.tab.locator(".ring:visible").count() == 0
    )


def test_a_difference_needs_two_runs_with_equal_times(pair):
    with pytest.raises(ValueError, match="two runs at least, got 'ray' alone"):
        cs.compare({"ray": pair["ray"]}, difference=True)
    with pytest.raises(
        ValueError, match="times of 'b' that 'a' has stored too, got 6 of 11: give fps= or times="
    ):
        cs.compare({"a": pair["ray"][::2], "b": pair["ray"]}, difference=True)
    assert cs.compare({"a": pair["ray"], "b": pair["ray"][::2]}, difference=True).difference is True
