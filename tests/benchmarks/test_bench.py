"""A run of the bench: its report, its files, and what it refuses."""

import itertools
import os
import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import clothsim as cs
import pytest
from bench import FULL, NORMAL, QUICK, SECTIONS, Settings, bench, machine_facts, plots, saved, works
from bench.report import text

BRIEF = Settings(
    windows=1,
    seconds=1e-5,
    large_windows=1,
    error_steps=3,
    sizes=(8, 16),
    numba_sizes=(),
    numba_parallel=False,
    reference_dt=5e-5,
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    grid = works.grid
    with pytest.MonkeyPatch.context() as patch:
        # Compilations, millions of points and threads that wait for each other do not belong in a
        # fast test.
        patch.setattr("peers.numba_peer.import_kernels", _no_numba)
        patch.setattr(machine_facts, "_MEMORY_BYTES", 1 << 20)
        patch.setattr(machine_facts.this_machine, "core_round_trip", lambda: 1.23e-7)
        patch.setattr(works, "grid", lambda rows: replace(grid(min(rows, 40)), name=f"grid {rows}"))
        return bench(folder, settings=BRIEF), folder


def _no_numba():
    raise ImportError("numba is not installed: run pip install '.[bench]' in a clone of clothsim")


def test_errors_stand_beside_times(report):
    result, _ = report
    errors = {
        precision: [
            f["error"]
            for f in result["figures"]
            if f["work"] == "swing+bend" and f["precision"] == precision and f["error"] is not None
        ]
        for precision in ("single", "double")
    }
    assert len(errors["single"]) > 2 and len(errors["double"]) > 2
    assert max(errors["double"]) < 1e-14 < 1e-12 < min(errors["single"])
    assert max(errors["single"]) < 1e-5
    assert all(f["minimum"] <= f["median"] for f in result["figures"])


def lines_with(printed, *words):
    """Lines that have all of these between spaces and commas."""
    lines = [(line, re.split(r"[ ,]+", line.strip())) for line in printed.splitlines()]
    return [line for line, cells in lines if set(map(str, words)) <= set(cells)]


def test_report_says_why_a_peer_is_missing(report):
    result, _ = report
    lines = text(result).splitlines()
    reason = "numba is not installed: run pip install '.[bench]' in a clone of clothsim"
    assert f"Left out (by numba strided): {reason}" in lines


def test_report_prints_every_figure(report):
    result, _ = report
    printed = text(result)
    for figure in result["figures"]:
        times = f"{1e6 * figure['minimum']:.2f}", figure["precision"]
        feature = figure["work"].startswith("feature: ")
        if feature:  # in a table of its kernel and precision, without medians
            work = figure["work"].removeprefix("feature: ")
            assert any(line.startswith(work + "  ") for line in lines_with(printed, times[0]))
            continue
        threads = "auto" if figure["threads"] is None else figure["threads"]
        words = (*times, f"{1e6 * figure['median']:.2f}", *figure["by"].split(), threads)
        found = lines_with(printed, *words)
        if f"\n{figure['work']}: {figure['springs']:,} springs\n" not in printed:
            found = [line for line in found if line.startswith(figure["work"] + "  ")]
        assert found
        if figure["error"] is not None:
            assert any(f"{figure['error']:.1e}" in line for line in found)


def test_the_cost_of_a_call_is_printed(report):
    result, _ = report
    assert {f["threads"] for f in result["figures"] if f["work"] == "32 x 32, cs.step"} == {
        1,
        min(2, result["machine"]["cores"]),
    }
    times = {
        ("2 x 2", 1): (2.0, 3.5, 4.25),
        ("32 x 32", 1): (8.0, 9.0, 20.0),
        ("32 x 32", 2): (5.0, 8.0, 21.0),
        ("grid 8", 1): (1.0, 0.0, 0.0),
    }
    endings = ("", ", a step a call", ", cs.step")
    figures = [
        {**f, "work": work + ending, "threads": threads, "minimum": 1e-6 * seconds}
        for f in result["figures"][:1]
        for (work, threads), three in times.items()
        for ending, seconds in zip(endings, three, strict=True)
        if seconds
    ]
    lines = text({**result, "figures": figures}).splitlines()
    table = lines[next(k for k, line in enumerate(lines) if line.startswith("Calls [us]")) :]
    shown = [line.split()[-5:] for line in table[3 : table.index("")]]
    assert shown == [
        ["single", "1", "2.00", "1.50", "2.25"],
        ["single", "1", "8.00", "1.00", "12.00"],
        ["single", "2", "5.00", "3.00", "16.00"],
    ]


def test_csv_is_read_as_it_was_written(report):
    """Numbers have four digits, errors two; limits and accuracy are read as well."""
    result, folder = report
    (path,) = folder.glob("*.csv")
    assert path.stat().st_size < 30_000
    read = saved.read(path)
    figures = list(read.figures)
    assert len(figures) == len(result["figures"]) > 100
    for one, written in zip(figures, result["figures"], strict=True):
        labels = (
            "work",
            "by",
            "precision",
            "threads",
            "instruction_set",
            "strict",
            "points",
            "springs",
            "flops",
            "error_steps",
        )
        assert [getattr(one, label) for label in labels] == [written[label] for label in labels]
        assert (one.minimum, one.median) == pytest.approx((written["minimum"], written["median"]), rel=1e-3)
        assert (one.error is None) == (written["error"] is None)
        assert one.error is None or one.error == pytest.approx(written["error"], rel=0.05)
    first, threads = result["machine"]["build"]["instruction_set"], result["limits"]["peak"][0]["threads"]
    peak = next(p for p in result["limits"]["peak"] if (p["instruction_set"], p["precision"]) == (first, "double"))
    assert read.limits["peak"][first, "double", threads] == pytest.approx(peak["flops_per_second"], rel=1e-3)
    assert read.instruction_sets[0] == first and set(read.sizes) == {8, 16}
    assert read.accuracy["edge"] == pytest.approx(result["accuracy"]["edge"], rel=1e-3)
    assert sorted(result["files"]) == sorted(map(str, folder.iterdir()))


def test_a_run_is_compared_with_the_file_that_was_there(report, tmp_path):
    result, _ = report
    path = tmp_path / "earlier.csv"
    assert saved.compare(result, path) is None
    slower = [{**f, "minimum": 1.25 * f["minimum"]} for f in result["figures"]]
    saved.write_csv(result, path)
    told = saved.compare({**result, "figures": slower}, path)
    assert "median 1.250" in told and f"({len(slower)} figures)" in told
    assert told in text({**result, "before": told})


@pytest.mark.parametrize(
    "settings, sections, lacks",
    [
        (NORMAL, SECTIONS, ""),
        (FULL, SECTIONS, ""),
        (QUICK, SECTIONS, "-quick"),
        (FULL, ("frames", "calls"), "-frames-calls"),
        (QUICK, ("limits",), "-quick-limits"),
        (replace(FULL, windows=3), SECTIONS, "-custom"),
    ],
)
def test_a_file_of_an_incomplete_run_names_the_missing_parts(settings, sections, lacks):
    about = machine_facts.describe()
    run = {"machine": about, "settings": asdict(settings), "sections": list(sections)}
    assert saved.name(run) == machine_facts.slug(about) + lacks


def test_a_table_or_a_plot_that_fails_loses_nothing_else(tmp_path, monkeypatch):
    """Nor does a grid of the size that the frames have."""

    def broken(*arguments):
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr("bench.efficiency", broken)
    monkeypatch.setitem(plots.ALL, "grids", broken)
    grid = works.grid
    monkeypatch.setattr(works, "grid", lambda rows: replace(grid(8), name=f"grid {rows}"))
    settings = replace(BRIEF, sizes=(8, 800))
    result = bench(tmp_path, settings=settings, sections=["features", "grids", "frames", "calls"])
    reason = "ZeroDivisionError: by hand"
    for label in ({"plot": "grids"}, {"table": "efficiency"}):
        assert {**label, "reason": reason} in result["skipped"]
    assert [p.stem.rsplit("-")[-1] for p in tmp_path.glob("*.png")] == ["features"]
    assert f"Left out (plot grids): {reason}" in text(result)


def test_limits_are_of_their_instruction_set_precision_and_threads(monkeypatch):
    def here():
        return os.environ["CLOTHSIM_ISA"]

    def bandwidth(threads, size):
        return {kind: (kind, here(), threads, size) for kind in ("update", "triad")}

    limits = SimpleNamespace(
        multiply_add_peak=lambda precision, threads: (here(), precision, threads),
        memory_bandwidth=bandwidth,
        core_round_trip=lambda: 1e-7,
    )
    monkeypatch.setattr(machine_facts, "this_machine", limits)
    found = machine_facts.limits(("avx2", "sse2"), (1, 2))
    assert set(found["peak"]) == set(itertools.product(("avx2", "sse2"), ("single", "double"), (1, 2)))
    assert all(rate == key for key, rate in found["peak"].items())
    for name, kind, size in (
        ("bandwidth", "update", 1 << 29),
        ("triad", "triad", 1 << 29),
        ("cache_bandwidth", "update", 1 << 14),
    ):
        assert found[name] == {n: (kind, "avx2", n, size) for n in (1, 2)}
    assert found["round_trip"] == 1e-7
    assert machine_facts.limits(("sse2",), (1,))["round_trip"] is None
    rows = machine_facts.as_plain(found)["peak"]
    assert {
        "instruction_set": "sse2",
        "precision": "double",
        "threads": 2,
        "flops_per_second": ("sse2", "double", 2),
    } in rows
    assert len(rows) == 8 and machine_facts.as_plain({}) == {}


def test_instruction_set_is_put_back(monkeypatch):
    monkeypatch.delenv("CLOTHSIM_ISA", raising=False)
    with machine_facts.instruction_set("sse2"):
        assert cs.build_config()["instruction_set"] == "sse2"
    assert cs.build_config()["instruction_set"] != "sse2"
