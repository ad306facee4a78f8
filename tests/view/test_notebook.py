"""What a notebook shows of a run and a scene as the last value of a cell."""

import base64
import re

import clothsim as cs
import numpy as np
import pytest

formatters = pytest.importorskip("IPython.core.formatters")


@pytest.fixture(scope="module")
def run():
    return cs.simulate(cs.scenes.paper_static(), 0.2, dt=1e-3, every=50)


def shown(value):
    """Return the MIME types that IPython sends to a notebook."""
    data, _ = formatters.DisplayFormatter().format(value)
    return data


def lines_of(data):
    """Return the lines that stand beside a picture."""
    return re.search(r"<pre[^>]*>(.*?)</pre>", data["text/html"], re.DOTALL)[1].splitlines()


def png_of(html):
    source = re.search(r'src="data:image/png;base64,([^"]+)"', html)[1]
    return base64.b64decode(source)


def test_a_run_shows_its_lines_and_its_last_frame(run):
    data = shown(run)
    assert lines_of(data) == str(run).splitlines() and len(lines_of(data)) == 7
    assert png_of(data["text/html"]) == run.picture(width=400)._repr_png_()
    assert base64.b64decode(data["image/png"]) == png_of(data["text/html"])
    assert data["text/plain"] == str(run) and len(data["text/html"]) < 200_000
    # JupyterLab's sanitizer leaves these elements, and data: in src, where a notebook is not
    # trusted.
    assert set(re.findall(r"<\s*(\w+)", data["text/html"])) == {"div", "pre", "img"}


def test_a_scene_shows_its_account_and_its_initial_state():
    scene = cs.scenes.paper_moving()
    data = shown(scene)
    assert png_of(data["text/html"]) == cs.picture(scene, width=400)._repr_png_()
    assert f"\n{scene.explain()}".endswith(lines_of(data)[-1]) and "3,906" in lines_of(data)[1]


def test_a_comparison_shows_its_labels_and_last_frames_or_draws_one_view(run, tmp_path):
    other = cs.simulate(cs.scenes.paper_static("reflect"), 0.1, dt=1e-3)
    both = cs.compare({"ray": run, "<reflect>": other})
    left, right = np.split(np.asarray(both.picture(t=0.15, width=150)), 2, axis=1)
    assert left.shape == right.shape and not np.array_equal(left, right)
    alone = run.picture(width=150).pixels
    joined = cs.compare({"a": run, "b": run}).picture(width=150, path=tmp_path / "both.png")
    same = np.split(joined.pixels, 2, axis=1)
    assert all(np.array_equal(one[-len(alone) :], alone) for one in same)
    titles = [one[: -len(alone)] for one in same]  # their names
    assert all((title < 100).any() for title in titles) and not np.array_equal(*titles)
    assert (tmp_path / "both.png").read_bytes() == joined._repr_png_()
    single = cs.compare({"a": run}).picture(path=tmp_path / "one.png", width=150)
    assert np.array_equal(single, alone)
    long = cs.compare({"a": run, 40 * "long": run}).picture(width=150)
    assert long.pixels[: len(titles[0]), 150].min() > 200  # each title has its own place
    html = shown(both)["text/html"]
    assert set(re.findall(r"<\s*(\w+)", html)) == {"div", "pre", "img"}
    assert re.findall(r"<pre[^>]*>(.*?)</pre>", html) == ["ray", "&lt;reflect&gt;"]
    last = html.rsplit("<img", 1)[1]
    assert png_of(last) == other.picture(width=400)._repr_png_()
    assert both.show(height=400)._repr_html_().startswith("<iframe")
    with pytest.raises(ValueError, match="height must be an integer >= 300"):
        run.show(height=10)
