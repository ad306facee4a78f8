"""A run of the bench: its report, its files, and what it refuses."""

import itertools
import re
from dataclasses import asdict, replace

import pytest
from bench import Settings, bench, machine_facts, saved, works
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


def test_report_prints_machine_and_limits(report):
    result, _ = report
    about, limits = result["machine"], result["limits"]
    known = {**about, "family": 25, "model": 17, "stepping": 1}
    printed = text({**result, "machine": known})
    assert f"{about['cpu']} (family 25, model 17, stepping 1), {about['cores']} cores" in printed
    unknown = {**about, **dict.fromkeys(("family", "model", "stepping"))}
    assert f"{about['cpu']}, {about['cores']} cores" in text({**result, "machine": unknown})
    sets, counts = about["build"]["instruction_sets_supported"], {1, min(2, about["cores"])}
    labels = {(p["instruction_set"], p["precision"], p["threads"]) for p in limits["peak"]}
    assert labels >= set(itertools.product(sets, ("single", "double"), counts))
    for p in limits["peak"]:
        rate = f"{p['flops_per_second'] / 1e9:.1f}"
        assert lines_with(printed, p["instruction_set"], p["precision"], p["threads"], rate)
    for name in ("bandwidth", "triad", "cache_bandwidth"):
        for threads, rate in limits[name].items():
            start = f"\n{name.replace('_', ' ')} [GB/s]: "
            line = printed[printed.index(start) :].split("\n")[1]
            assert rate > 0 and f"{rate / 1e9:.1f} on {threads}" in line
    if about["cores"] > 1:
        assert "core to core and back: 123 ns" in printed
    for one in result["efficiency"]:
        percent = f"{100 * one['share_of_peak']:.0f}"
        times = (f"{1e9 * one[k]:.2f}" for k in one if k.endswith("seconds_per_point"))
        assert lines_with(printed, one["work"], one["kernel"], one["precision"], percent, *times)
    assert {one["work"] for one in result["efficiency"]} == {"swing+bend"}


def test_ratios_stand_beside_times(report):
    result, _ = report
    lines = text(result).splitlines()
    for work in ("static+bend", "feature: all springs, damped"):
        one = next(f for f in result["figures"] if f["work"] == work)
        ratios = [f"{one[column]:.1f}" for column in ("x_reference", "x_numpy")]
        rows = [line.split() for line in lines if f"{1e6 * one['minimum']:.2f}" in line.split()]
        assert any(row[-2:] == ratios for row in rows)


def test_what_a_call_adds_is_printed(report):
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


@pytest.mark.parametrize(("together", "told"), [(231e9, False), (117e9, True)])
def test_report_tells_of_processors_on_one_core(report, together, told):
    """A virtual machine's: the second adds nothing while it lasts."""
    result, _ = report
    rates = [("single", 1, 117e9), ("single", 2, together), ("double", 1, 58e9), ("double", 2, 115e9)]
    peak = [{"instruction_set": "avx512", "precision": p, "threads": n, "flops_per_second": rate} for p, n, rate in rates]
    speeds = dict.fromkeys(("bandwidth", "triad", "cache_bandwidth"), {1: 2e10, 2: 4e10})
    limits = {"peak": peak, **speeds, "round_trip": 1.2e-7}
    printed = text({**result, "limits": limits})
    assert ("processors shared a core" in printed) == told
    assert ("2 threads reached 1.00 times the peak of one" in printed) == told


@pytest.mark.parametrize(("load", "told"), [(0.4, False), (0.6, True)])
def test_report_tells_of_load_before_the_run(report, load, told):
    result, _ = report
    printed = text({**result, "machine": {**result["machine"], "load_average": (load, 2.0, 3.0)}})
    assert f"before the run {load:.2f}, 2.00, 3.00" in printed
    assert ("Something ran in the minute before" in printed) == told


def test_report_tells_windows_and_steps_of_errors(report):
    result, _ = report
    settings = asdict(replace(BRIEF, windows=40, seconds=4e-3, large_windows=7))
    printed = text({**result, "settings": settings})
    assert "least of 40 windows of 4 ms" in printed
    assert "batch, 5 of 32 ms; grids above 1024 x 1024, 7 one after the other" in printed
    assert "32 x 32 mass points; the error is that of the position after 3 steps" in printed
    assert "calls; the error is that of the position after 20 steps" in printed
    with_error = {f["work"] for f in result["figures"] if f["error"] is not None}
    assert with_error == {"swing", "swing+bend", "static", "static+bend", "grid 8", "grid 16"}


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
