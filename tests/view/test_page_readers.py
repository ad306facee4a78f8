"""Pages for all readers: keys, fingers, small and dark screens, words for curves; the probe and the difference of runs."""

import clothsim as cs
import numpy as np
import pytest
from pages import pixels, seek


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
