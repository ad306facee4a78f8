"""What the bench makes of its figures: targets, ratios to peers, shares of the limits."""

from dataclasses import replace

import pytest
import targets
from bench import figures as measured_run
from bench.figures import Figure, Figures, Missing, efficiency, ratios, traffic


def figure(**changes):
    values = {
        "work": "static",
        "by": "edge",
        "precision": "single",
        "threads": 2,
        "instruction_set": "avx512",
        "strict": False,
        "points": 1024,
        "springs": 3906,
        "minimum": 3e-6,
        "median": 4e-6,
        "windows": 1,
        "steps": 1,
        "flops": 400_000,
    }
    return Figure(**{**values, **changes})


def measured(*figures, kernels=("gather", "edge"), threads=(1, 2), **changes):
    store = Figures()
    store.add(figures)
    values = {
        "figures": store,
        "kernels": kernels,
        "instruction_sets": ("avx512", "avx2", "sse2"),
        "threads": threads,
        "limits": {},
        "accuracy": None,
    }
    return measured_run.Measured(**{**values, **changes})


def row(name, given):
    target = next(t for t in targets.TARGETS if t.name == name)
    return target.evaluate(given)


TWO_THREADS = "step, 3,906 springs, single, 2 threads"


def test_targets_are_judged_in_their_own_direction():
    met = row(TWO_THREADS, measured(figure(minimum=3.4e-6)))
    assert met["met"] and met["value"] == pytest.approx(3.4)
    assert not row(TWO_THREADS, measured(figure(minimum=3.6e-6)))["met"]
    frames = "800 x 800, single, 2 threads, a step a frame"
    work = "frame 800, a step a call"
    assert row(frames, measured(figure(work=work, minimum=1 / 301)))["met"]
    assert not row(frames, measured(figure(work=work, minimum=1 / 299)))["met"]


def test_a_missing_figure_says_why():
    assert row(TWO_THREADS, measured(kernels=("gather",)))["missing"] == "not built yet"
    assert row(TWO_THREADS, measured(threads=(1,)))["missing"] == "needs 2 cores"
    assert row(TWO_THREADS, measured())["missing"] == "not measured in this run"
    store = Figures()
    store.skip("numba is not installed", by="numba strided")
    with pytest.raises(Missing, match="numba is not installed"):
        store.get(work="swing", by="numba strided")
    twice = measured(figure(), figure())
    assert "2 figures have the labels" in row(TWO_THREADS, twice)["missing"]


def test_numba_on_one_thread_or_on_its_best_is_beside_ours():
    ours = figure(work="swing+bend", threads=1, minimum=8e-6, flops=760_000)
    numba = figure(work="swing+bend", by="numba strided", threads=1, minimum=24e-6, instruction_set="")
    ratio = row("numba (strong, 1 thread) / ours on 1, single", measured(ours, numba))
    assert ratio["value"] == pytest.approx(3.0) and ratio["met"]
    given = (ours, replace(ours, threads=2, minimum=4e-6), numba)
    best = "numba (strong, its best thread count) / ours on 2, single"
    assert row(best, measured(*given))["missing"] == "not measured in this run"
    for seconds, value in ((18e-6, 4.5), (30e-6, 6.0)):
        two = measured(*given, replace(numba, threads=2, minimum=seconds))
        assert row(best, two)["value"] == pytest.approx(value)
        alone = row("numba (strong, 1 thread) / ours on 1, single", two)
        assert alone["value"] == pytest.approx(3.0)


def test_efficiency_is_beside_the_limits_of_its_threads_and_of_memory_where_that_counts():
    small = {"work": "swing+bend", "threads": 1, "minimum": 8e-6, "flops": 760_000}
    large = {"work": "grid 1024", "threads": 2, "points": 1024**2, "minimum": 6.291456e-3, "flops": 786_432_000}
    limits = {"peak": {("avx512", "single", 1): 118.75e9, ("avx512", "single", 2): 250e9}, "bandwidth": {1: 12e9, 2: 24e9}}
    given = [figure(**{**work, "by": by}) for by in ("edge", "gather") for work in (small, large)]
    decoy = figure(**{**large, "threads": 1})
    rows = efficiency(measured(*given, decoy, limits=limits))
    assert [(r["work"], r["kernel"], r["threads"]) for r in rows] == [
        ("swing+bend", "gather", 1),
        ("swing+bend", "edge", 1),
        ("grid 1024", "gather", 2),
        ("grid 1024", "edge", 2),
    ]

    def nanoseconds(r):
        limits = ("arithmetic_seconds_per_point", "memory_seconds_per_point")
        return [1e9 * r[key] for key in ("seconds_per_point", *limits)]

    assert rows[1]["flops_per_second"] == pytest.approx(95e9)
    assert rows[1]["share_of_peak"] == pytest.approx(0.8)
    assert nanoseconds(rows[0]) == pytest.approx([7.8125, 6.25, 40.0])
    assert nanoseconds(rows[1]) == pytest.approx([7.8125, 6.25, 8.0])
    assert nanoseconds(rows[2]) == pytest.approx([6.0, 3.0, 20.0])
    assert nanoseconds(rows[3]) == pytest.approx([6.0, 3.0, 4.0])
    assert [r["bytes_per_point_step"] for r in rows] == [480, 96, 480, 96]
    # What stays in cache is not bound by memory, however slow that is.
    assert [r["bound"] for r in rows] == ["arithmetic", "arithmetic", "memory", "memory"]
    fast = {**limits, "bandwidth": {1: 60e9, 2: 60e9}}
    rows = efficiency(measured(*given, limits=fast))
    assert [r["bound"] for r in rows[2:]] == ["memory", "arithmetic"]


def test_traffic_of_the_gather_kernel_is_that_of_its_four_sweeps():
    state = stage_a = stage_b = compensation = 6
    first = total = 3
    fetched = [
        state + stage_a + first,
        stage_a + state + stage_b + total,
        stage_b + state + stage_a + total,
        stage_a + state + first + total,
    ]
    written = [stage_a + first, stage_b + total, stage_a + total, state]
    values = sum(fetched) + sum(written)
    assert traffic("gather", "double") == 8 * values
    assert traffic("gather", "single") == 4 * (values + 2 * compensation)
    assert traffic("edge", "single") == traffic("edge", "double") == 2 * 6 * 8


@pytest.mark.parametrize("what", ["structural", "shear", "bend", "damping"])
def test_a_disabled_feature_saves_its_traffic(what):
    every = figure(work=measured_run.ALL_SPRINGS, threads=1, minimum=10e-6, flops=1000)
    less = figure(work=f"feature: no {what}", threads=1, minimum=8.5e-6, flops=800)
    saved = f"time saved without {what} / its share of the flops, single"
    assert row(saved, measured(every, less))["value"] == pytest.approx(0.75)


def peer(by, minimum, **changes):
    return figure(**{"work": "swing", "by": by, "threads": 1, "instruction_set": "", **changes}, minimum=minimum, flops=None)


PEERS = (
    peer("reference", 60e-6, precision="double"),
    peer("numpy", 900e-6),
    peer("numpy", 1200e-6, precision="double"),
    peer("numba gather", 45e-6),
    peer("numba gather", 30e-6, threads=2),
    peer("numba gather", 90e-6, precision="double"),
    peer("numba strided", 24e-6),
    peer("numba strided", 27e-6, threads=2),
    # Faster than all of the above, and of something else.
    peer("numpy", 1e-6, work="swing+bend", springs=5826),
    peer("numba gather", 1e-6, work="swing+bend", springs=5826),
    peer("numba strided", 1e-6, work="grid 8", points=64),
    peer("numba strided", 1e-6, work="batch"),
)


@pytest.mark.parametrize("work", ["swing", "static", "contact", "feature: no bend"])
def test_ratios_are_to_the_fastest_peer_of_the_same_precision_and_springs(work):
    ours = figure(work=work, threads=1)
    assert ratios(ours, (ours, *PEERS)) == pytest.approx(
        {"x_reference": 20, "x_numpy": 300, "x_numba_gather": 10, "x_numba_strided": 8}
    )
    double = figure(work=work, minimum=6e-6, precision="double")
    assert ratios(double, (*PEERS, double)) == pytest.approx(
        {"x_reference": 10, "x_numpy": 200, "x_numba_gather": 15, "x_numba_strided": None}
    )


def test_ratios_of_grids_and_batches_are_to_peers_on_the_same():
    batch = figure(work="batch", minimum=5e-6, springs=5826)
    grid = figure(work="grid 1024", minimum=5e-3, springs=6_281_218, points=1024**2)
    paused = figure(work="32 x 32, 20 steps after 50 ms")
    numba = [
        peer("numba strided", 25e-6, work="batch", springs=5826),
        peer("numba strided", 15e-6, work="batch", springs=5826, threads=2),
        peer("numba strided", 20e-3, work="grid 1024", springs=6_281_218, points=1024**2),
    ]
    others = dict.fromkeys(("x_reference", "x_numpy", "x_numba_gather"))
    assert ratios(batch, (*PEERS, *numba)) == pytest.approx({**others, "x_numba_strided": 3})
    assert ratios(grid, (*PEERS, *numba)) == pytest.approx({**others, "x_numba_strided": 4})
    damping = [figure(work=f"feature: {what}") for what in ("no damping", "mass per point")]
    for none in (figure(work="grid 32"), paused, numba[0], *damping):
        assert set(ratios(none, (*PEERS, *numba)).values()) == {None}
