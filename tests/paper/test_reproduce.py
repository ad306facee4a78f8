"""The reproduction: its numbers, its pictures and its report folder."""

import json
import re
import signal
import threading
from html.parser import HTMLParser
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("matplotlib")

from clothsim.paper import FULL, QUICK, Settings, reproduce, text
from clothsim.paper import responses as contact
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
    gpu_sizes=(32,),
    gpu_batches=(2,),
    gpu_seconds=0.02,
    comparison_part=0.02,
    picture_width=120,
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return reproduce(tmp_path_factory.mktemp("report"), settings=SMALL, threads=1)


@pytest.fixture(scope="module")
def folder(report):
    return Path(report["folder"])


def with_gpu(report):
    """Whether this machine had a graphics adapter for experiment 4."""
    return "gpu" in report["experiments"]["4"]


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


def test_static_sphere_is_touched_at_all_frames_and_energy_is_accounted_for(report):
    for frame in FULL.static_frames:
        assert cell(report, "1", 2, "corrected", frame)["points_touching"] > 0
        turned = cell(report, "1", 1, "corrected", frame)["contact_energy"]
        assert abs(turned) < 1e-9  # turning a velocity keeps its length
    # Moving points makes energy in proportion to the step: 10.8 J at dt = 1e-4, 47 J at 4e-4.
    assert 12 < cell(report, "1", 2, "corrected", 800)["contact_energy"] < 40


def test_printed_methods_fail_on_the_moving_sphere_and_corrected_ones_hold(report):
    assert cell(report, "2", 1, "as printed", 200)["penetration"]["points"] > 0.02
    assert cell(report, "2", 1, "as printed", 1300)["penetration"]["points"] > 0.04
    assert cell(report, "2", 2, "as printed", 3100)["contact_energy"] > 1e5
    for method in (1, 2):
        last = cell(report, "2", method, "corrected", 3100)
        assert last["deepest_so_far"]["triangles"] < 2.5e-3
        assert 1e3 < last["contact_energy"] < 2e4  # the moving sphere's work


def test_moving_sphere_is_in_its_first_second_and_third_contact(report):
    for frame in FULL.moving_frames:
        for method in (1, 2):
            assert cell(report, "2", method, "corrected", frame)["points_touching"] > 0
    motion = contact.experiment("2", FULL).scene().spheres[0].motion
    turns = [1.6e-3 * frame / motion.period + motion.phase for frame in FULL.moving_frames]
    halves = [int(2 * turn) for turn in turns]
    assert halves == [0, 1, 2]


def test_one_step_a_frame_shows_the_papers_static_difference(report):
    first, second = report["experiments"]["1"]["step_study"]
    assert (first["method"], second["method"]) == (1, 2)
    assert first["penetration"][0]["points"] > 1e-3
    assert all(depth["points"] == 0 for depth in second["penetration"])


def test_rates_are_consistent(report):
    for number in ("3", "4"):
        entry = report["experiments"][number]
        assert entry["frame_steps"] == 320
        for row in entry["rows"]:
            assert row["microseconds_per_step"] * row["steps_per_second"] == pytest.approx(1e6)
            assert row["frames_per_second"] * 320 == pytest.approx(row["steps_per_second"])
            assert row["lower_quartile"] <= row["steps_per_second"] <= row["upper_quartile"]
    assert len(report["experiments"]["3"]["rows"][0]["windows"]) == 2
    reference, *core = report["experiments"]["4"]["rows"]
    assert reference["speedup"] == 1
    for row in core:
        expected = row["steps_per_second"] / reference["steps_per_second"]
        assert row["speedup"] == pytest.approx(expected)
        assert len(row["runs"]) == 2
    assert report["experiments"]["4"]["agreement"] < 1e-12


def test_json_is_the_returned_report_and_says_where_it_comes_from(report, folder):
    assert json.loads((folder / "report.json").read_text()) == report
    assert report["schema"] == 1
    assert report["provenance"]["build"]["version"] == cs.__version__
    assert report["provenance"]["machine"]["cpu"]
    assert report["settings"]["static_dt"] == 2e-4


def table_rows(lines, number, experiment):
    """Cells of the main table of an experiment in report.txt, as strings."""
    start = lines.index(f"Experiment {number}: {experiment['title']}")
    rule = next(k for k in range(start + 2, len(lines)) if re.fullmatch(r"[- ]+", lines[k]))
    end = lines.index("", rule)
    return [re.split(r" {2,}", line.strip()) for line in lines[rule + 1 : end]]


def test_text_shows_the_numbers_of_the_json(report, folder):
    lines = (folder / "report.txt").read_text().splitlines()
    assert text(report).splitlines() == lines
    for number in ("1", "2"):
        experiment = report["experiments"][number]
        rows = table_rows(lines, number, experiment)
        assert len(rows) == 12
        for frame, time, method, variant, *values in rows:
            c = cell(report, number, int(method), variant, int(frame))
            expected = [
                1e3 * c["penetration"]["points"],
                1e3 * c["penetration"]["triangles"],
                1e3 * c["deepest_so_far"]["triangles"],
                c["points_touching"],
                c["contact_energy"],
                c["energy"]["kinetic"],
            ]
            shown = [float(value.replace(",", "")) for value in values]
            assert shown == pytest.approx(expected, rel=5e-3)
            assert float(time) == pytest.approx(c["time"], abs=5e-3)
    for row, shown in zip(
        report["experiments"]["4"]["rows"], table_rows(lines, "4", report["experiments"]["4"]), strict=True
    ):
        assert float(shown[4].replace(",", "")) == pytest.approx(row["steps_per_second"], rel=5e-3)


def test_claims_and_notes_are_shown(report):
    shown = " ".join(text(report).split())
    assert "{" not in shown
    for experiment in report["experiments"].values():
        assert experiment["paper"] in shown
        for note in experiment["notes"]:
            assert note in shown
    assert "positions of core and reference differ by at most" in report["experiments"]["4"]["notes"][0]


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
    assert page.tags.count("a") == 5 and page.tags.count("img") == len(page.references) - 5 == 24 + 4 + 1 + with_gpu(report)
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


@pytest.mark.parametrize("key", ["1", "2"])
def test_tables_can_be_played(report, folder, key):
    """Four runs whose frames include those that the table shows; tests/view plays such pages."""
    experiment = report["experiments"][key]
    source = (folder / experiment["page"]).read_text()
    meta = json.loads(re.search(r'<script type="application/json" id="meta">(.*?)</script>', source)[1])
    assert [run["label"] for run in meta["runs"]] == [
        f"method {m}, {variant}" for variant in ("as printed", "corrected") for m in (1, 2)
    ]
    for run in meta["runs"]:
        times = np.array(run["t"])
        for frame in experiment["frames"]:
            assert np.abs(times - frame * experiment["frame_dt"]).min() < 1e-9
        depth = run["curves"]["triangles"]
        for c in experiment["cells"]:
            if f"method {c['method']}, {c['variant']}" == run["label"]:
                at = np.abs(times - c["time"]).argmin()
                assert depth[at] == pytest.approx(c["penetration"]["triangles"], rel=1e-4, abs=1e-9)
    assert len(source) < 8_000_000


def test_pictures_decode_and_show_something(report, folder):
    pictures = sorted(folder.rglob("*.png"))
    assert len(pictures) == 24 + 2 * 2 + 2 + 1 + with_gpu(report)
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


def test_interrupt_ends_all_cases():
    done = []

    def advance(frames):
        done.append(frames)
        if len(done) == 5:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        contact.run(contact.experiment("2", FULL), FULL, threads=2, advance=advance)
    assert sum(done) < 50


@pytest.mark.parametrize(
    "arguments, named",
    [
        ({"experiments": (1, 6)}, "experiments"),
        ({"experiments": ()}, "experiments"),
        ({"threads": 0}, "threads"),
        ({"out": __file__}, "out must be a folder"),
        ({"settings": Settings(static_dt=3e-4), "experiments": (1,)}, "frame_dt"),
    ],
)
def test_wrong_arguments_are_named(tmp_path, arguments, named):
    with pytest.raises(ValueError, match=named):
        reproduce(**{"out": tmp_path, **arguments})
