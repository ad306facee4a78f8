"""The reproduction: its numbers, its pictures and its report folder."""

import itertools
import json
from html.parser import HTMLParser
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("matplotlib")

from clothsim.paper import FULL, QUICK, Settings, reproduce
from clothsim.paper.paper_settings import reductions
from matplotlib.image import imread

SMALL = Settings(
    static_dt=2e-4,
    moving_dt=4e-4,
    study_dts=(1.6e-3,),
    timing_dt=2e-4,
    runs=2,
    windows=2,
    window_frames=5,
    speedup_steps=20,
    comparison_part=0.02,
    picture_width=120,
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return reproduce(tmp_path_factory.mktemp("report"), settings=SMALL, threads=1)


@pytest.fixture(scope="module")
def folder(report):
    return Path(report["folder"])


def cell(report, experiment, method, variant, frame):
    (found,) = (
        c
        for c in report["experiments"][experiment]["cells"]
        if (c["method"], c["variant"], c["frame"]) == (method, variant, frame)
    )
    return found


def test_full_run_takes_the_papers_frames_and_step():
    assert (FULL.static_dt, FULL.moving_dt, FULL.timing_dt) == (5e-6, 5e-6, 5e-6)
    assert (FULL.static_frames, FULL.moving_frames) == ((150, 500, 800), (200, 1300, 3100))
    assert (FULL.runs, FULL.window_frames) == (10, 200)
    assert reductions(FULL) == []
    assert (QUICK.static_frames, QUICK.moving_frames) == (FULL.static_frames, FULL.moving_frames)


def test_cells_are_those_of_the_papers_tables(report):
    for experiment, frames in (("1", FULL.static_frames), ("2", FULL.moving_frames)):
        cells = report["experiments"][experiment]["cells"]
        keys = [(c["variant"], c["method"], c["frame"]) for c in cells]
        assert sorted(keys) == sorted((v, m, f) for v in ("as printed", "corrected") for m in (1, 2) for f in frames)
        for c in cells:
            assert c["time"] == pytest.approx(1.6e-3 * c["frame"], rel=1e-12)
            energy = c["energy"]
            parts = energy["kinetic"] + energy["elastic"] + energy["gravity"]
            assert energy["total"] == pytest.approx(parts, rel=1e-12)
            assert 0 <= c["penetration"]["points"] <= c["penetration"]["triangles"]
            assert c["penetration"]["triangles"] <= c["deepest_so_far"]["triangles"] <= 0.25


def test_a_cell_equals_the_stepped_scene(report):
    scene = cs.scenes.paper_static("ray")
    stepper = cs.Stepper(scene, threads=1)
    stepper.advance(150 * 8, 2e-4)
    measured = cell(report, "1", 2, "corrected", 150)
    kinetic = cs.energy(scene, stepper.positions, stepper.velocities)["kinetic"]
    assert measured["energy"]["kinetic"] == pytest.approx(kinetic, rel=1e-12)
    depth = cs.penetration(stepper.positions, scene.spheres[0])
    assert measured["penetration"] == pytest.approx(dict(depth), rel=1e-12)


def test_static_sphere_is_touched_at_all_frames_and_the_cloth_only_loses_energy(report):
    start = cs.energy(cs.scenes.paper_static(), *[cs.scenes.paper_static().initial_position] * 2)["gravity"]
    for method, frame in itertools.product((1, 2), FULL.static_frames):
        found = cell(report, "1", method, "corrected", frame)
        assert found["points_touching"] > 0
        assert found["energy_gained"] == pytest.approx(found["energy"]["total"] - start, abs=1e-9)
        assert found["energy_gained"] < -10


def test_printed_methods_fail_on_the_moving_sphere_and_corrected_ones_hold(report):
    assert cell(report, "2", 1, "as printed", 200)["penetration"]["points"] > 0.02
    assert cell(report, "2", 1, "as printed", 1300)["penetration"]["points"] > 0.04
    assert cell(report, "2", 2, "as printed", 200)["energy_gained"] > 1e3  # out of nothing
    for method in (1, 2):
        last = cell(report, "2", method, "corrected", 3100)
        assert last["deepest_so_far"]["triangles"] < 2.5e-3
        assert last["energy_gained"] < 0


def test_one_step_a_frame_shows_the_papers_static_difference(report):
    first, second = report["experiments"]["1"]["step_study"]
    assert (first["method"], second["method"]) == (1, 2)
    assert first["penetration"][0]["points"] > 1e-3
    assert all(depth["points"] == 0 for depth in second["penetration"])


def test_json_is_the_returned_report_and_says_where_it_comes_from(report, folder):
    assert json.loads((folder / "report.json").read_text()) == report
    assert report["schema"] == 1
    assert report["provenance"]["build"]["version"] == cs.__version__
    assert report["provenance"]["machine"]["cpu"]
    assert report["settings"]["static_dt"] == 2e-4


class Page(HTMLParser):
    VOID = frozenset({"meta", "img", "br"})

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.references = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.references += [v for k, v in attributes if k in ("src", "href", "srcset", "data")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_whole_and_fetches_nothing(report, folder):
    source = (folder / "index.html").read_text()
    page = Page()
    page.feed(source)
    assert page.open == []
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    links = [r for r in page.references if not r.startswith("data:image/png;base64,")]
    assert links == ["live.html", "table3.html", "live_static.html", "table4.html", "live_moving.html"]
    assert page.tags.count("a") == 5 and page.tags.count("img") == len(page.references) - 5 == 24 + 4 + 1
    style = source[source.index("<style>") : source.index("</style>")]
    assert "url(" not in style and "@import" not in style


def test_the_gallery_leads_to_live_pages_of_the_scenes(folder):
    page = Page()
    page.feed((folder / "live.html").read_text())
    links = [r for r in page.references if not r.startswith("data:")]
    assert links == ["live_static.html", "live_moving.html", "live_swing.html", "live_continuous.html"]
    for name in ("live.html", *links):
        assert (folder / name).stat().st_size < 400_000
        assert "://" not in (folder / name).read_text()


def test_pictures_decode_and_show_something(report, folder):
    pictures = sorted(folder.rglob("*.png"))
    assert len(pictures) == 24 + 2 * 2 + 2 + 1
    for path in pictures:
        pixels = imread(path)[..., :3]
        assert min(pixels.shape[:2]) >= 40
        assert len(np.unique(pixels[::2, ::2].reshape(-1, 3), axis=0)) > 50
        assert 0.005 < np.mean((pixels < 0.95).any(axis=-1)) < 0.9
    shown = {p.relative_to(folder).as_posix() for p in pictures}
    cells = {c["picture"] for n in "12" for c in report["experiments"][n]["cells"]}
    assert cells <= shown
    for name in cells:
        pixels = imread(folder / name)[..., :3]
        ink = (pixels[: -round(pixels.shape[1] / 20)] < 0.95).any(axis=-1)  # without the strip
        assert max(ink.any(axis=0).mean(), ink.any(axis=1).mean()) > 0.8, name  # the camera is that of the cell


def test_unstable_run_is_reported_not_hidden(tmp_path):
    settings = Settings(static_dt=3.2e-3, frame_dt=3.2e-3, static_frames=(10, 150), study_dts=(3.2e-3,), picture_width=60)
    entry = reproduce(tmp_path, settings=settings, experiments=(1,))["experiments"]["1"]
    assert all(h["failure"] for h in entry["histories"])
    assert {c["frame"] for c in entry["cells"]} == {10}
    assert entry["step_study"] == []
    assert "ended early" in (tmp_path / "report.txt").read_text()
    assert "ended early" in (tmp_path / "index.html").read_text()
