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
    """The MIME types that IPython sends to a notebook."""
    data, _ = formatters.DisplayFormatter().format(value)
    return data


def lines_of(data):
    """The six lines that stand beside a picture."""
    lines = re.search(r"<pre[^>]*>(.*?)</pre>", data["text/html"], re.DOTALL)[1].splitlines()
    assert len(lines) == 6 and all(len(line) < 100 for line in lines)
    return lines


def png_of(html):
    source = re.search(r'src="data:image/png;base64,([^"]+)"', html)[1]
    return base64.b64decode(source)


def test_a_run_shows_its_lines_and_its_last_frame(run):
    data = shown(run)
    assert lines_of(data) == str(run).splitlines()
    assert png_of(data["text/html"]) == run.picture(width=400)._repr_png_()
    assert base64.b64decode(data["image/png"]) == png_of(data["text/html"])
    assert data["text/plain"] == str(run) and len(data["text/html"]) < 200_000
    # JupyterLab's sanitizer leaves these elements, and data: in src, where a notebook is not trusted.
    assert set(re.findall(r"<\s*(\w+)", data["text/html"])) == {"div", "pre", "img"}


def test_a_scene_shows_its_initial_state():
    scene = cs.scenes.paper_moving()
    data = shown(scene)
    assert png_of(data["text/html"]) == cs.picture(scene, width=400)._repr_png_()
    lines = lines_of(data)
    assert "3,906 springs" in lines[1]
    assert lines[3] == "initial energy 0 J (kinetic 0 J, elastic 0 J, gravity 0 J)"
    assert lines[4] == "initial penetration: points 0 m, triangles 0 m"
    assert lines[5].startswith(f"stable time step {cs.max_stable_dt(scene):.4g} s with rk4, limited by the damping")


def test_a_comparison_shows_its_labels_and_last_frames(run):
    other = cs.simulate(cs.scenes.paper_static("reflect"), 0.1, dt=1e-3)
    both = cs.compare({"ray": run, "<reflect>": other})
    html = shown(both)["text/html"]
    assert set(re.findall(r"<\s*(\w+)", html)) == {"div", "pre", "img"}
    assert re.findall(r"<pre[^>]*>(.*?)</pre>", html) == ["ray", "&lt;reflect&gt;"]
    last = html.rsplit("<img", 1)[1]
    assert png_of(last) == other.picture(width=400)._repr_png_()
    assert both.show(height=400)._repr_html_().startswith("<iframe")
    with pytest.raises(ValueError, match="height must be an integer >= 300"):
        run.show(height=10)


def test_a_comparison_draws_its_runs_side_by_side_in_one_view(run):
    other = cs.simulate(cs.scenes.paper_static("reflect"), 0.1, dt=1e-3)
    both = cs.compare({"ray": run, "reflect": other})
    drawn = both.picture(t=0.15, width=150)
    left, right = np.split(np.asarray(drawn), 2, axis=1)
    assert left.shape == right.shape and not np.array_equal(left, right)
    same = cs.compare({"a": run, "b": run}).picture(width=150)
    assert np.array_equal(*np.split(np.asarray(same), 2, axis=1))
    assert np.array_equal(np.asarray(same)[:, :150], run.picture(width=150))
