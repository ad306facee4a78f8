"""The reproduction: its numbers, its findings and its report folder."""

import dataclasses
import json
from html.parser import HTMLParser
from pathlib import Path

import clothsim as cs
import numpy as np
import pytest

pytest.importorskip("matplotlib")

from clothsim.base.progress import ProgressBar
from clothsim.cli import main
from clothsim.paper import FULL, LIVE_PAGES, QUICK, Settings, report_as_text, reproduce
from clothsim.paper.experiments import (
    CASES,
    FRAMES,
    QUANTITIES,
    SIZES,
    VARIANTS,
    PassedPoints,
    sharpest_fold_in_degrees,
)
from clothsim.paper.findings import format_number, judge_claims
from clothsim.paper.report import list_reductions
from matplotlib.image import imread

SMALL = Settings(
    (2e-4, 4e-4, 2e-4), study_dts=(1.6e-3,), runs=2, timed_frames=10, speedup_steps=20, part=0.02
)


BARS = []  # of the report


class Bar(ProgressBar):
    """A bar that counts and shows nothing."""

    def __init__(self, shown, total, **options):
        super().__init__(shown)
        self.total = total
        self.count = 0
        BARS.append(self)

    def advance(self, count=1):
        self.count += count


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("clothsim.paper.ProgressBar", Bar)
        return reproduce(tmp_path_factory.mktemp("report"), settings=SMALL, threads=1)


@pytest.fixture(scope="module")
def folder(report):
    return Path(report["folder"])


def cell(report, experiment, method, variant, frame):
    key = f"method {method}, {variant}", frame
    (matches,) = (
        c for c in report["experiments"][experiment]["cells"] if (c["case"], c["frame"]) == key
    )
    return matches


def test_full_run_takes_the_papers_frames_and_step():
    assert FULL.dt == (5e-6, 5e-6, 5e-6) and list_reductions(FULL) == []
    assert FRAMES == {"1": (150, 500, 800), "2": (200, 1300, 3100)}
    assert (FULL.runs, FULL.timed_frames, FULL.steps_per_frame()) == (10, 800, 320)
    assert len(list_reductions(QUICK)) == 6


def test_a_cell_equals_the_stepped_scene(report):
    scene = cs.scenes.paper_static("ray")
    stepper = cs.Stepper(scene, threads=1)
    stepper.advance(150 * 8, 2e-4)
    measured = cell(report, "1", 2, "corrected", 150)
    kinetic = cs.energy(scene, stepper.positions, stepper.velocities)["kinetic"]
    assert measured["kinetic_energy"] == pytest.approx(kinetic, rel=1e-12)
    depth = cs.penetration(stepper.positions, scene.spheres[0])
    assert {name: measured[name] for name in depth} == pytest.approx(dict(depth), rel=1e-12)
    assert measured["time"] == pytest.approx(0.24, rel=1e-12)


def test_static_sphere_is_touched_at_all_frames_and_the_cloth_only_loses_energy(report):
    for method in (1, 2):
        for frame in FRAMES["1"]:
            value = cell(report, "1", method, "corrected", frame)
            assert value["points_touching"] > 0 and value["energy_gained"] < -10


def test_printed_methods_fail_on_the_moving_sphere_and_corrected_ones_hold(report):
    assert cell(report, "2", 1, "as printed", 200)["points"] > 0.02
    assert cell(report, "2", 1, "as printed", 3100)["points_passed"] > 40
    assert cell(report, "2", 2, "as printed", 200)["energy_gained"] > 1e3  # energy from nothing
    for method in (1, 2):
        last = cell(report, "2", method, "corrected", 3100)
        assert last["triangles_so_far"] < 2.5e-3
        assert last["energy_gained"] < 0 == last["points_passed"]


def test_one_step_a_frame_shows_the_papers_static_difference(report):
    first, second = report["experiments"]["1"]["study"]
    assert (first["case"], second["case"]) == tuple(CASES)[:2]
    assert first["points"][0] > 1e-3 and second["points"] == [0, 0, 0]


def test_points_that_leave_on_another_side_have_passed():
    cloth = cs.Cloth((1, 3), springs=(), damping=0.0, pins=())
    scene = cs.Scene(
        cloth, cs.Sphere((0, 0, 0), 1.0), position=[[[0, 2, 0], [0.5, 2, 0], [3, 2, 0]]]
    )
    x = scene.initial_position
    passed = PassedPoints(x, 1.0)
    for y in (0.5, -0.5, -2.0):  # the first two go through the sphere, the third beside it
        passed.count_passed(np.where([False, True, False], y, x))
    assert passed.count == 2
    passed.count_passed(np.where([False, True, False], -0.5, x))
    passed.count_passed(np.where([False, True, False], -2.0, x))  # they go out where they came in
    assert passed.count == 2
    passed.count_passed(x)  # they go through it between two states
    assert passed.count == 4


def test_findings_follow_the_numbers(report):
    judgements = judge_claims(report["experiments"])
    verdicts = [finding.verdict for claims in judgements.values() for finding in claims]
    assert len(verdicts) == 10 and set(verdicts) <= {"yes", "in part", "no", "not measured"}
    assert verdicts[0] == "in part"  # the edge as printed
    assert verdicts[3] == "no"  # method 2's folds
    rows = [{"case": name, "frames_per_second": 500.0 - 100 * (name[7] == "2")} for name in CASES]
    slower, quick = judge_claims({"3": {"rows": rows, "frame_steps": 320}})["3"]
    assert (slower.verdict, quick.verdict) == ("yes", "yes") and "400" in slower.corrected
    cells = [
        {"case": name, "triangles": 5e-3 * (name[7] == "1")} for name in CASES for _ in FRAMES["1"]
    ]
    static, offset = judge_claims({"1": {"cells": cells, "study": []}})["1"]
    assert offset.verdict == "yes" and "1 mm" in offset.criterion
    assert (
        static.verdict == "yes"
        and static.printed == "method 1: 5 / 5 / 5 mm; method 2: 0 / 0 / 0 mm"
    )
    rows = [
        {"case": "core, double, 1 thread", "times_the_first": 8.0},
        {
            "case": "shader, single",
            "times_the_first": 16.0,
            "steps_per_second": 100.0,
            "each": [80.0, 100.0, 101.0],
        },
    ]
    gpu, first = judge_claims({"4": {"rows": rows, "missing": ""}})["4"]
    assert gpu.verdict == "yes" and "2 times" in gpu.corrected
    assert first.verdict == "yes" and "0.8 times" in first.corrected


@pytest.mark.parametrize(
    ("one", "two", "held"),
    [((128, 0.03), (0, 1e-3), "yes"), ((128, 0.03), (463, 0.2), "no"), ((0, 0), (0, 0), "no")]
    + [((128, 0.03), (3, 0.02), "in part"), ((0, 1e-3), (463, 0.2), "no")],
)
def test_a_claim_that_the_numbers_refute_does_not_hold_in_part(one, two, held):
    cells = [
        {
            "case": f"method {k}, {variant}",
            "frame": 200,
            "points_passed": passed,
            "triangles_so_far": depth,
            "points_touching": 20,
            "points": 0.0,
            "sharpest_fold": {1: 120.0, 2: 40.0}[k],
        }
        for variant in VARIANTS
        for k, (passed, depth) in enumerate((one, two), 1)
    ]
    moving, edge, slow = judge_claims({"2": {"cells": cells}})["2"]
    assert moving.verdict == held and "10 mm" in moving.criterion
    assert slow.verdict == "no" and "frames 1300 and 3100" in slow.criterion
    assert edge.verdict == "yes" and "90 degrees" in edge.criterion


def test_a_sharp_fold_is_an_angle_between_neighbouring_cells():
    flat = cs.Cloth((3, 5)).rest_positions
    bent = flat.copy()
    bent[:, 3:] = flat[:, 2:3] + (flat[:, 3:] - flat[:, 2:3])[..., [1, 0, 2]]  # up at x of column 2
    assert sharpest_fold_in_degrees(np.stack([flat, bent])) == pytest.approx([0.0, 90.0], abs=1e-5)


def test_the_bar_of_each_experiment_has_its_total(report):
    assert [bar.count for bar in BARS] == pytest.approx([bar.total for bar in BARS])
    assert BARS[1].total == pytest.approx(3100 * 1.6e-3)  # s of simulated time, of experiment 2


def test_one_step_a_frame_means_one_thing(report):
    assert "one step a frame" not in report_as_text(report)


def test_the_terminal_ends_with_a_line_for_each_claim(report, monkeypatch, capsys):
    monkeypatch.setattr("clothsim.paper.reproduce", lambda *_, **__: report)
    assert main(["reproduce"]) in (0, None)
    lines = capsys.readouterr().out.strip().splitlines()[-10:]
    rows = [row for claims in judge_claims(report["experiments"]).values() for row in claims]
    assert [line.split(":")[0] for line in lines] == [row.verdict for row in rows]
    assert all(row.claim in line for row, line in zip(rows, lines, strict=True))
    assert all(row.criterion in " ".join(report_as_text(report).split()) for row in rows)


def test_depths_are_stored_in_metres_and_shown_in_millimetres(report, folder):
    assert QUANTITIES["points"].heading == "deepest point [mm]"
    depth = cell(report, "2", 1, "as printed", 200)["points"]
    assert depth > 0.02
    assert (
        f"deepest point [mm]: {format_number(1e3 * depth)};" in (folder / "report.txt").read_text()
    )


def test_every_column_and_every_size_is_explained(folder):
    content = " ".join((folder / "report.txt").read_text().split())
    for quantity in QUANTITIES.values():
        assert quantity.definition in content
    assert SIZES.keys() == {field.name for field in dataclasses.fields(Settings)}
    assert content.count("Table 3, frames 150") == 1


def test_rounding_is_zero():
    assert [format_number(v) for v in (5e-15, -2.25e-14, 0.0)] == ["0"] * 3
    assert [format_number(v) for v in (-0.00123, 1234.5, 2.4e-5)] == [
        "-0.00123",
        "1,230",
        "2.40e-05",
    ]


def test_json_is_the_returned_report_and_says_where_it_comes_from(report, folder):
    content = json.loads((folder / "report.json").read_text())
    assert content["experiments"].keys() == report["experiments"].keys() == set("12345")
    assert content["experiments"]["4"]["rows"] == report["experiments"]["4"]["rows"]
    assert report["provenance"]["build"]["version"] == cs.__version__
    assert (folder / "report.txt").read_text() == report_as_text(report)


class PageReader(HTMLParser):
    VOID = frozenset({"meta", "img", "br"})

    def __init__(self):
        super().__init__()
        self.open = []
        self.tags = []
        self.references = []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.references += [v for k, v in attributes if k in ("src", "href", "srcset", "data")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_whole_and_fetches_nothing(folder):
    source = (folder / "index.html").read_text()
    page = PageReader()
    page.feed(source)
    assert page.open == []
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    links = [r for r in page.references if not r.startswith("data:image/png;base64,")]
    assert {link.partition("#")[0] for link in links} == {
        *("live.html", "report.txt", "report.json", "live_static.html", "live_moving.html"),
        *("experiment1.html", "experiment2.html"),
    }
    assert "experiment2.html#t=2.08" in links
    assert all((folder / link.partition("#")[0]).exists() for link in links)
    assert page.tags.count("img") == 24
    assert (
        source.index("Did it hold?")
        < source.index("Experiment 1")
        < source.index("What this short form cuts")
    )
    assert source.count("<strong>Here:</strong>") == 5


def test_the_gallery_leads_to_live_pages_of_the_scenes(folder):
    page = PageReader()
    page.feed((folder / "live.html").read_text())
    links = [r for r in page.references if not r.startswith("data:")]
    assert links == list(LIVE_PAGES)
    for name in ("live.html", *links):
        assert (folder / name).stat().st_size < 400_000
        assert "://" not in (folder / name).read_text()


def test_pictures_show_something_and_those_of_a_frame_have_one_scale(report, folder):
    for number_, frames in FRAMES.items():
        for frame in frames:
            cells = [c for c in report["experiments"][number_]["cells"] if c["frame"] == frame]
            paths = [c["picture"] for c in cells]
            # The label of an "as printed" one has a further line.
            shapes = {
                (c["case"].split(", ")[1], imread(folder / c["picture"]).shape) for c in cells
            }
            assert len(paths) == 4 and len(shapes) == len(VARIANTS)
            for path in paths:
                pixels = imread(folder / path)[..., :3]
                assert 0.005 < np.mean((pixels < 0.95).any(axis=-1)) < 0.9


def test_unstable_run_is_reported_not_hidden(tmp_path, monkeypatch):
    monkeypatch.setitem(FRAMES, "1", (10, 150))
    settings = Settings((3.2e-3,) * 3, frame_dt=3.2e-3, study_dts=(3.2e-3,))
    entry = reproduce(tmp_path, settings=settings, experiments=(1,))["experiments"]["1"]
    assert len(entry["failures"]) == 4
    assert {c["frame"] for c in entry["cells"]} == {10}
    assert entry["study"] == []
    assert "ended early" in (tmp_path / "report.txt").read_text()


@pytest.mark.parametrize("key", "12345")
def test_an_experiment_alone_is_a_report(report, key):
    single = report_as_text({**report, "experiments": {key: report["experiments"][key]}})
    assert f"Experiment {key}" in single and "Did it hold?" in single
