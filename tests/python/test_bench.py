"""A run of the bench: its report, its files, and what it refuses."""

import csv
import json
from dataclasses import asdict, replace

import clothsim as cs
import pytest
from clothsim._json import as_json
from clothsim.benchmark import FULL, NORMAL, QUICK, SECTIONS, Settings, bench, files, machine
from clothsim.benchmark import plots, targets, works
from clothsim.benchmark.report import text

BRIEF = Settings(
    windows=1, seconds=1e-5, large_windows=1, error_steps=3, sizes=(8, 16), numba_sizes=(),
    numba_parallel=False, reference_dt=5e-5,
)  # fmt: skip


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    patch = pytest.MonkeyPatch()
    # Compilations and millions of points do not belong in a fast test.
    patch.setattr("clothsim.benchmark.numba_peer.import_kernels", _no_numba)
    grid = works.grid
    patch.setattr(works, "grid", lambda rows: replace(grid(min(rows, 40)), name=f"grid {rows}"))
    try:
        yield bench(folder, settings=BRIEF, sections=set(SECTIONS) - {"limits"}), folder
    finally:
        patch.undo()


def _no_numba():
    raise ImportError("numba is not installed: pip install 'clothsim[bench]'")


def test_errors_stand_beside_times(report):
    result, _ = report
    errors = {
        precision: [
            f["error"] for f in result["figures"]
            if f["work"] == "swing+bend" and f["precision"] == precision and f["error"] is not None
        ]
        for precision in ("single", "double")
    }  # fmt: skip
    assert len(errors["single"]) > 2 and len(errors["double"]) > 2
    assert max(errors["double"]) < 1e-14 < 1e-12 < min(errors["single"])
    assert max(errors["single"]) < 1e-5
    assert all(f["minimum"] <= f["median"] for f in result["figures"])


def test_report_prints_every_target_and_every_figure(report):
    result, _ = report
    printed = text(result)
    for target in targets.TARGETS:
        assert target.name in printed
    assert "numba is not installed" in printed
    for work in (
        "swing: 3,906 springs",
        "swing+bend: 5,826 springs",
        "no bend",
        "batch",
        "grid 16",
    ):
        assert work in printed


def test_ratios_stand_beside_times(report):
    result, _ = report
    lines = text(result).splitlines()
    for work in ("static+bend", "feature: all springs, damped"):
        one = next(f for f in result["figures"] if f["work"] == work)
        shown = [f"{1e6 * one['minimum']:.2f}", f"{one['x_reference']:.1f}", f"{one['x_numpy']:.1f}"]
        assert any(line.split()[-2:] == shown[1:] and shown[0] in line.split() for line in lines)


def test_what_a_call_adds_is_printed(report):
    result, _ = report
    assert {f["threads"] for f in result["figures"] if f["work"] == "32 x 32, cs.step"} == {
        1, min(2, result["machine"]["cores"])
    }  # fmt: skip
    times = {("2 x 2", 1): (2.0, 3.5, 4.25), ("32 x 32", 1): (8.0, 9.0, 20.0),
             ("32 x 32", 2): (5.0, 8.0, 21.0), ("grid 8", 1): (1.0, 0.0, 0.0)}  # fmt: skip
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
    peak = [
        {"instruction_set": "avx512", "precision": p, "threads": n, "flops_per_second": rate}
        for p, n, rate in rates
    ]
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


@pytest.mark.parametrize("instruction_set", ["avx512", "avx2", "sse2"])
def test_report_tells_that_targets_are_those_of_avx512(report, instruction_set):
    result, _ = report
    machine = result["machine"]
    build = {**machine["build"], "instruction_set": instruction_set}
    printed = text({**result, "machine": {**machine, "build": build}})
    assert ("two cores with AVX-512" in printed) == (instruction_set != "avx512")


def test_csv_holds_every_figure(report):
    result, folder = report
    files = [path for path in folder.glob("*.csv") if not path.stem.endswith("-targets")]
    (path,) = files
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result["figures"])
    assert [float(r["minimum"]) for r in rows] == [f["minimum"] for f in result["figures"]]
    assert all(r["cpu"] and r["created"] and r["instruction_set"] != "None" for r in rows)
    for column in ("x_reference", "x_numpy", "x_numba_gather", "x_numba_strided"):
        written = [float(r[column]) if r[column] else None for r in rows]
        assert written == [f[column] for f in result["figures"]]
    with_peers = [r for r in rows if r["work"] in ("static", "contact+bend", "feature: no bend")]
    assert with_peers and all(r["x_reference"] and r["x_numpy"] for r in with_peers)
    assert not any(r["x_numba_strided"] for r in rows)


def test_json_holds_everything_that_is_printed_as_such(report):
    result, folder = report
    (path,) = folder.glob("*.json")
    assert path.read_text() == as_json(result) + "\n"
    assert sorted(result["files"]) == sorted(map(str, folder.iterdir()))


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
def test_files_say_what_a_run_lacks(report, settings, sections, lacks):
    result, _ = report
    run = {**result, "settings": asdict(settings), "sections": list(sections)}
    assert files.name(run) == machine.slug(result["machine"]) + lacks


def test_a_target_or_a_plot_that_fails_loses_nothing_else(tmp_path, monkeypatch):
    """Nor does a grid of the size that the frames have."""

    def broken(*arguments):
        raise ZeroDivisionError("by hand")

    chosen, other = (t.name for t in targets.TARGETS[-2:])
    last = replace(targets.TARGETS[-1], value=broken)
    monkeypatch.setattr(targets, "TARGETS", (*targets.TARGETS[:-1], last))
    monkeypatch.setattr("clothsim.benchmark.efficiency.efficiency", broken)
    monkeypatch.setitem(plots.ALL, "grids", broken)
    grid = works.grid
    monkeypatch.setattr(works, "grid", lambda rows: replace(grid(8), name=f"grid {rows}"))
    settings = replace(BRIEF, sizes=(8, 800))
    result = bench(tmp_path, settings=settings, sections=["features", "grids", "frames", "calls"])
    reason = "ZeroDivisionError: by hand"
    for label in ({"target": other}, {"plot": "grids"}, {"table": "efficiency"}):
        assert {**label, "reason": reason} in result["skipped"]
    rows = {one["target"]: one for one in result["targets"]}
    assert rows[other]["missing"] == "failed" and rows[chosen]["value"] is not None
    assert rows["800 x 800, single, 2 threads, a step a frame"]["value"] is not None or (
        result["machine"]["cores"] == 1
    )
    (written,) = tmp_path.glob("*.json")
    assert json.loads(written.read_text())["skipped"] == result["skipped"]
    assert [p.stem.rsplit("-")[-1] for p in tmp_path.glob("*.png")] == ["features"]
    assert all(f"Left out ({k} {v}): {reason}" in text(result)
               for k, v in (("target", other), ("plot", "grids")))  # fmt: skip


def test_sections_are_named_in_one_order_and_tables_of_nothing_are_not_written(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(machine, "limits", lambda *arguments: {})
    start = files.slug(machine.describe())
    bench(tmp_path, settings=BRIEF, sections=["limits"])
    bench(tmp_path, settings=BRIEF, sections=["calls", "limits"])
    both = f"{start}-custom-limits-calls"
    expected = {f"{start}-custom-limits.json", *(both + e for e in (".csv", "-targets.csv", ".json"))}
    assert {path.name for path in tmp_path.iterdir()} == expected


@pytest.mark.parametrize("out, error", [(__file__, ValueError), (7, TypeError)])
def test_what_is_no_folder_is_refused_before_measuring(monkeypatch, out, error):
    monkeypatch.delattr("clothsim.benchmark.machine.describe")
    with pytest.raises(error, match="out must be"):
        bench(out)


@pytest.mark.parametrize(
    "sections, error, told",
    [
        ("steps", TypeError, r"got 'steps' \(str\)"),
        (7, TypeError, r"got 7 \(int\)"),
        (["limits", "step"], ValueError, r"got 'step' \(did you mean 'steps'\?\)"),
        ((), ValueError, r"got \(\)"),
    ],
)
def test_what_are_no_sections_is_refused_before_measuring(monkeypatch, sections, error, told):
    monkeypatch.delattr("clothsim.benchmark.machine.describe")
    some = "sections must be a collection of some of 'limits', 'steps'"
    with pytest.raises(error, match=f"{some}.*{told}"):
        bench(None, sections=sections)


def test_instruction_set_is_put_back(monkeypatch):
    monkeypatch.delenv("CLOTHSIM_ISA", raising=False)
    with machine.instruction_set("sse2"):
        assert cs.build_config()["instruction_set"] == "sse2"
    assert cs.build_config()["instruction_set"] != "sse2"
