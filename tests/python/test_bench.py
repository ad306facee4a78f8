"""The bench's logic: windows, comparisons with targets, peers that compute the same, and files.
No test depends on how fast anything is."""

import csv
import itertools
from dataclasses import replace

import clothsim as cs
import numpy as np
import pytest
from clothsim.benchmark import SECTIONS, Settings, bench, machine, targets, works
from clothsim.benchmark.efficiency import efficiency
from clothsim.benchmark.figures import Figure, Figures, Missing
from clothsim.benchmark.numpy_peer import NumpyPeer
from clothsim.benchmark.report import text
from clothsim.benchmark.settings import PAPER_DT
from clothsim.benchmark.timing import calibrate, measure

BRIEF = Settings(
    windows=1, seconds=1e-5, large_windows=1, error_steps=3, sizes=(8, 16), numba_sizes=(),
    numba_parallel=False, reference_dt=5e-5,
)  # fmt: skip


class Fake:
    """A work whose steps take a stated time on a clock of its own."""

    def __init__(self, clock, costs):
        self.clock, self.costs = clock, itertools.cycle(costs)
        self.log = []

    def prepare(self):
        self.log.append("prepare")

    def run(self, steps):
        self.log.append(steps)
        self.clock.now += steps * next(self.costs)


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_measure_takes_the_least_and_the_middle_window():
    clock = Clock()
    work = Fake(clock, [1.0])
    # One step fills a window of 0.5 s; one goes before it, whatever it takes.
    steady = measure([work], 3, 0.5, clock)[0]
    assert (steady.minimum, steady.median, steady.steps) == (1.0, 1.0, 1)
    work = Fake(clock, [5.0, 5.0, 5.0, 5.0, 9.0, 1.0, 0.1, 2.0, 9.0, 30.0])
    timing = measure([work], 3, 0.5, clock)[0]
    assert (timing.minimum, timing.median, timing.windows) == (1.0, 2.0, 3)


def test_measure_takes_turns():
    clock = Clock()
    order = []

    class Named(Fake):
        def prepare(self):
            order.append(self)

    named = [Named(clock, [1.0]) for _ in range(4)]
    measure(named, 5, 0.5, clock)
    rounds = [order[i : i + 4] for i in range(4, 24, 4)]
    assert all(set(one) == set(named) for one in rounds)
    assert len({tuple(map(id, one)) for one in rounds}) > 1


def test_calibrate_fills_the_window_and_ignores_one_slow_try():
    clock = Clock()
    assert calibrate(Fake(clock, [1e-6]), 1e-3, clock) in range(800, 1300)
    # The first try after the warm-up is a hundred times too slow.
    assert calibrate(Fake(clock, [1e-6, 1e-3] + 100 * [1e-6]), 1e-3, clock) in range(800, 1300)


def figure(**changes):
    values = {
        "work": "static", "by": "edge", "precision": "single", "threads": 2,
        "instruction_set": "avx512", "strict": False, "points": 1024, "springs": 3906,
        "minimum": 3e-6, "median": 4e-6, "windows": 1, "steps": 1, "flops": 400_000,
    }  # fmt: skip
    return Figure(**{**values, **changes})


def measured(*figures, kernels=("gather", "edge"), threads=(1, 2), **changes):
    store = Figures()
    store.add(figures)
    values = {
        "figures": store, "settings": BRIEF, "kernels": kernels,
        "instruction_sets": ("avx512", "avx2", "sse2"), "threads": threads, "limits": {},
        "accuracy": None,
    }  # fmt: skip
    return targets.Measured(**{**values, **changes})


def row(name, given):
    target = next(t for t in targets.TARGETS if t.name == name)
    return target.evaluate(given)


TWO_THREADS = "step, 3,906 springs, single, 2 threads"


def test_targets_are_judged_in_their_own_direction():
    met = row(TWO_THREADS, measured(figure(minimum=3.4e-6)))
    assert met["met"] and met["value"] == pytest.approx(3.4)
    assert not row(TWO_THREADS, measured(figure(minimum=3.6e-6)))["met"]
    frames = "800 x 800, single, 2 threads, a step a frame"
    assert row(frames, measured(figure(work="grid 800", minimum=1 / 301)))["met"]
    assert not row(frames, measured(figure(work="grid 800", minimum=1 / 299)))["met"]


def test_a_missing_figure_says_why():
    assert row(TWO_THREADS, measured(kernels=("gather",)))["missing"] == "not built yet"
    assert row(TWO_THREADS, measured(threads=(1,)))["missing"] == "needs 2 cores"
    assert row(TWO_THREADS, measured())["missing"] == "not measured in this run"
    store = Figures()
    store.skip("numba is not installed", by="numba strided")
    with pytest.raises(Missing, match="numba is not installed"):
        store.get(work="swing", by="numba strided")


def test_derived_targets():
    ours = figure(work="swing+bend", threads=1, minimum=8e-6, flops=760_000)
    numba = figure(work="swing+bend", by="numba strided", threads=1, minimum=24e-6,
                   instruction_set="")  # fmt: skip
    ratio = row("numba (strong, 1 thread) / ours on 1, single", measured(ours, numba))
    assert ratio["value"] == pytest.approx(3.0) and ratio["met"]
    limits = {"peak": {("avx512", "single", 1): 118.75e9}, "bandwidth": {1: 24e9}}
    given = measured(ours, limits=limits)
    share = row("share of the multiply-add peak, single, 1 thread", given)
    assert share["value"] == pytest.approx(80.0)
    (line,) = efficiency(given)
    assert line["flops_per_second"] == pytest.approx(95e9)
    assert line["memory_seconds_per_point"] == pytest.approx(4e-9)
    assert line["arithmetic_seconds_per_point"] == pytest.approx(6.25e-9)
    assert line["bound"] == "arithmetic"
    every = figure(work=targets.ALL_SPRINGS, threads=1, minimum=10e-6, flops=1000)
    less = figure(work="feature: no bend", threads=1, minimum=8e-6, flops=800)
    saved = "time saved without bend / its share of the flops, single"
    assert row(saved, measured(every, less))["value"] == pytest.approx(1.0)


def test_instruction_set_is_put_back(monkeypatch):
    monkeypatch.delenv("CLOTHSIM_ISA", raising=False)
    with machine.instruction_set("sse2"):
        assert cs.build_config()["instruction_set"] == "sse2"
    assert cs.build_config()["instruction_set"] != "sse2"


def check_peer(make, **options):
    for bend in (False, True):
        start = works.paper(bend, sphere=False)
        expected, _ = cs.reference_step(start.scene, start.x, start.v, PAPER_DT, 20)
        moved = np.abs(expected - start.x).max()
        peer = make(start.scene, start.x, start.v, PAPER_DT, np.float64, **options)
        peer.prepare()
        peer.run(20)
        assert np.abs(peer.positions - expected).max() < 1e-12 * moved


def test_numpy_peer_computes_the_same_cloth():
    check_peer(NumpyPeer)


@pytest.mark.parametrize("name", ("NumbaGather", "NumbaStrided"))
def test_numba_peers_compute_the_same_cloth(name):
    pytest.importorskip("numba")
    from clothsim.benchmark import numba_peer

    check_peer(getattr(numba_peer, name), threads=1)


def test_cloth_is_put_back_before_it_has_moved_far():
    start = works.paper(False, sphere=False)
    work = works.Core(start, by="gather", precision="double", threads=1,
                      instruction_set=cs.build_config()["instruction_set"])  # fmt: skip
    work.run(5000)
    work.prepare()
    assert work.stepper.time == start.t
    assert np.array_equal(work.positions, start.x)


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
        assert target.name.strip() in printed
    assert "numba is not installed" in printed
    for work in (
        "swing: 3,906 springs",
        "swing+bend: 5,826 springs",
        "no bend",
        "batch",
        "grid 16",
    ):
        assert work in printed


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


@pytest.mark.parametrize("out, error", [(__file__, ValueError), (7, TypeError)])
def test_what_is_no_folder_is_refused_before_measuring(monkeypatch, out, error):
    monkeypatch.delattr("clothsim.benchmark.machine.describe")
    with pytest.raises(error, match="out must be"):
        bench(out)


def test_unknown_section_is_refused():
    with pytest.raises(ValueError, match="sections must be some of"):
        bench(None, sections=["speed"])
