"""Pages for all readers: keys, fingers, small and dark screens, words for curves; the probe and the difference of runs."""

import clothsim as cs
import numpy as np
import pytest
from pages import frames, pixels, seek

DARK = {"color_scheme": "dark"}


@pytest.fixture(scope="module")
def runs():
    pair = {name: cs.scenes.paper_static(name) for name in ("reflect", "ray")}
    return {name: cs.simulate(scene, 0.5, dt=1e-3, fps=20) for name, scene in pair.items()}


@pytest.fixture(scope="module")
def both(runs, tmp_path_factory):
    return cs.compare(runs, difference=True).to_html(tmp_path_factory.mktemp("page") / "both.html")


def test_a_probe_shows_the_values_of_a_point_of_all_runs_and_their_curves(both, runs, opened):
    page = opened(both)
    page.ready()
    charts = page.tab.locator("#curves canvas").count()
    seek(page, 8)
    page.tab.fill("#row", "31")
    page.tab.fill("#column", "5")
    page.tab.press("#column", "Enter")
    found = cs.difference(*runs.values())["distance"]
    for k, run in enumerate(runs.values()):
        at = run.at(31, 5)
        said = page.tab.inner_text(f"#says-{k}")
        assert "row 31, column 5" in said
        numbers = [float(part.split()[-2]) for part in said.split(": ")[1].split(", ")]
        expected = [100 * at["stretch"][8], at["speed"][8], 1000 * found[8, 31, 5] * k]
        # 255 levels of the square root of the highest value
        highest = page.tab.evaluate("page.runs[0].highest")
        for value, right, name, factor in zip(numbers, expected, ("stretch", "speed", "difference"), (100, 1, 1000)):
            top = factor * highest[name]
            assert abs(value - right) <= 0.01 * right + 2 * np.sqrt(right * top) * 0.51 / 255 + 1e-3 * top
    assert page.tab.locator("#curves canvas").count() == charts + 3
    page.tab.fill("#row", "")
    page.tab.fill("#column", "")
    page.tab.press("#column", "Enter")
    assert page.tab.locator("#curves canvas").count() == charts and page.said == []


def test_a_click_probes_the_point_below_it_and_a_drag_does_not(both, runs, opened):
    page = opened(both)
    page.ready()
    page.tab.click("button:text-is('top')")
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
    assert page.tab.evaluate("page.state.probe") is None and page.tab.locator(".ring:visible").count() == 0


@pytest.mark.slow
def test_the_difference_is_a_colour_and_a_curve(both, runs, opened):
    page = opened(both)
    page.ready()
    seek(page, 10)
    page.tab.select_option("#mode", label="difference to reflect")
    assert len(np.unique(pixels(page, 1).reshape(-1, 3), axis=0)) > len(np.unique(pixels(page, 0).reshape(-1, 3), axis=0))
    rms = cs.difference(*runs.values())["rms"]
    label = page.tab.locator("#curves canvas").last.get_attribute("aria-label")
    assert label.startswith("rms difference to the first run [mm]. ray: first 0 at 0 s, last ")
    assert float(label.split("last ")[1].split()[0]) == pytest.approx(1000 * rms[-1], rel=6e-3)


def test_a_difference_needs_two_runs_with_equal_times(runs):
    with pytest.raises(ValueError, match="two runs at least, got 'ray' alone"):
        cs.compare({"ray": runs["ray"]}, difference=True)
    with pytest.raises(ValueError, match="times of 'b' that 'a' has stored too, got 6 of 11: give fps= or times="):
        cs.compare({"a": runs["ray"][::2], "b": runs["ray"]}, difference=True)
    assert cs.compare({"a": runs["ray"], "b": runs["ray"][::2]}, difference=True).difference is True


@pytest.mark.slow
def test_keys_work_wherever_the_focus_is_except_in_text_fields(both, opened):
    page = opened(both)
    page.ready()
    for k, place in enumerate(("#canvas-1", "#back", "#mode", "#time", "button:text-is('top')")):
        page.tab.focus(place)
        page.tab.keyboard.press("ArrowRight")
        assert frames(page) == [k + 1, k + 1], place
        page.tab.keyboard.press(" ")
        assert page.tab.evaluate("page.state.playing") is True, place
        page.tab.keyboard.press(" ")
        assert page.tab.evaluate("page.state.playing") is False, place
        seek(page, k + 1)
    page.tab.click("#forth")
    page.tab.click("#forth")
    assert frames(page) == [7, 7]
    page.tab.click("#back")
    page.tab.click("#back")
    page.tab.focus("#row")
    page.tab.keyboard.press("ArrowRight")
    page.tab.keyboard.press(" ")
    assert frames(page) == [5, 5] and page.tab.evaluate("page.state.playing") is False


@pytest.mark.slow
def test_a_focused_cloth_has_a_role_and_a_name_and_turns_by_keys(both, opened):
    page = opened(both)
    page.ready()
    canvas = page.tab.get_by_role("application", name="Cloth and spheres of ray")
    canvas.focus()
    before = page.tab.evaluate("[page.camera.azimuth, page.camera.elevation, page.camera.zoom]")
    for key in ("Shift+ArrowLeft", "Shift+ArrowUp", "+"):
        page.tab.keyboard.press(key)
    after = page.tab.evaluate("[page.camera.azimuth, page.camera.elevation, page.camera.zoom]")
    assert np.array(after) - before == pytest.approx([0.16, -0.16, 0.2])
    page.tab.keyboard.press("0")
    assert page.tab.evaluate("page.camera.zoom") == 1 and frames(page) == [0, 0]


@pytest.mark.slow
def test_two_fingers_enlarge_and_move(both, opened):
    page = opened(both)
    page.ready()
    script = """(steps) => {
      const canvas = document.getElementById("canvas-0"), box = canvas.getBoundingClientRect();
      canvas.setPointerCapture = () => {};
      for (const [type, pointerId, x, y] of steps) canvas.dispatchEvent(new PointerEvent(type, {
        pointerId, pointerType: "touch", button: 0, buttons: 1, bubbles: true,
        clientX: box.x + box.width / 2 + x, clientY: box.y + box.height / 2 + y }));
      return [page.camera.zoom, ...page.camera.target, page.camera.azimuth, page.state.probe];
    }"""
    start = page.tab.evaluate(script, [])
    down = [["pointerdown", 1, -30, 0], ["pointerdown", 2, 30, 0]]
    spread = [["pointermove", 1, -60, 0], ["pointermove", 2, 60, 0]]
    zoom, *target, azimuth, _ = page.tab.evaluate(script, down + spread)
    assert zoom == pytest.approx(2.0) and azimuth == start[4] and target == pytest.approx(start[1:4], abs=1e-3)
    height = "(c) => 2 * page.camera.extent(c.clientWidth / c.clientHeight)[1] / c.clientHeight"
    metre = page.tab.locator("#canvas-0").evaluate(height)
    up = [["pointermove", 1, -60, 40], ["pointermove", 2, 60, 40], ["pointerup", 1, -60, 40], ["pointerup", 2, 60, 40]]
    zoom, *moved, azimuth, probe = page.tab.evaluate(script, up)
    assert np.linalg.norm(np.subtract(moved, target)) == pytest.approx(40 * metre, rel=1e-6)
    assert probe is None and azimuth == start[4]


@pytest.mark.slow
def test_a_run_of_two_frames_has_marks_and_a_sentence(runs, both, tmp_path, opened):
    page = opened(runs["ray"][::10].to_html(tmp_path / "two.html"))
    page.ready()
    assert "nothing between them is shown: give fps=30" in page.tab.inner_text("#few")
    # Coloured pixels of a curve lie at its two ends alone.
    script = """(c) => {
      const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data, found = [];
      for (let k = 0; k < d.length; k += 4)
        if (d[k + 3] > 200 && d[k + 2] > d[k] + 80) found.push((k / 4) % c.width / c.width);
      return found; }"""
    places = np.array(page.tab.locator("#curves canvas").nth(1).evaluate(script))
    assert len(places) > 20 and not ((places > 0.35) & (places < 0.9)).any()
    assert opened(both).tab.locator("#few").count() == 0


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, DARK], ids=["light", "dark"])
def test_texts_have_a_contrast_of_four_and_a_half(both, opened, options):
    page = opened(both, **options)
    page.ready()
    script = """() => {
      const c = document.createElement("canvas").getContext("2d");
      const rgb = (color) => {
        c.fillStyle = color; c.fillRect(0, 0, 1, 1);
        return [...c.getImageData(0, 0, 1, 1).data].slice(0, 3);
      };
      const texts = "h1, figcaption, figcaption b, label, button, select, [type=number], .small, #clock, #high";
      return [...document.querySelectorAll(texts)].map((e) => {
        let back = e;
        while (getComputedStyle(back).backgroundColor === "rgba(0, 0, 0, 0)") back = back.parentElement;
        return [e.outerHTML.slice(0, 60), rgb(getComputedStyle(e).color), rgb(getComputedStyle(back).backgroundColor)];
      }); }"""
    found = page.tab.evaluate(script)
    assert len(found) > 20

    def luminance(rgb):
        part = np.array(rgb) / 255
        return np.dot([0.2126, 0.7152, 0.0722], np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4))

    for what, ink, ground in found:
        low, high = sorted((luminance(ink), luminance(ground)))
        assert (high + 0.05) / (low + 0.05) >= 4.5, what
    corner = pixels(page)[2, 2]
    assert (corner < 40).all() if options else (corner == 255).all()


@pytest.mark.slow
def test_a_narrow_page_has_one_column_and_eight_runs_fit_a_screen(runs, tmp_path, opened):
    eight = {f"run {k}": runs["ray"][::5] for k in range(8)}
    page = opened(cs.compare(eight).to_html(tmp_path / "eight.html"))
    page.ready()
    page.tab.set_viewport_size({"width": 1400, "height": 900})
    bottom = page.tab.evaluate("document.getElementById('curves').getBoundingClientRect().bottom")
    assert bottom <= 900
    page.tab.set_viewport_size({"width": 390, "height": 844})
    lefts = page.tab.evaluate("[...document.querySelectorAll('.stage')].map((s) => s.getBoundingClientRect().left)")
    assert len(set(lefts)) == 1
    assert page.tab.evaluate("document.documentElement.scrollWidth") == 390
    assert page.said == []
