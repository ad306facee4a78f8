"""What the bench times: windows, works, and peers that compute the same cloth.
No test depends on how fast anything is."""

import itertools
from dataclasses import replace

import clothsim as cs
import numpy as np
import pytest
from bench import QUICK, candidates, works
from bench.figures import Figures
from clothsim.scenes import PAPER_DT
from peers.numpy_peer import NumpyPeer
from timing import Work, calibrate, measure


class Fake(Work):
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


def test_a_cold_window_has_its_steps_and_nothing_before_them():
    clock = Clock()
    cold, warm = Fake(clock, [7.0, 5.0, 2.0, 3.0]), Fake(clock, [1.0])
    cold.cold_steps = 4
    timing, other = measure([cold, warm], 3, 0.5, clock)
    assert cold.log == 4 * ["prepare", 4]
    assert (timing.minimum, timing.median, timing.steps, timing.windows) == (2.0, 3.0, 4, 3)
    assert (other.minimum, other.steps) == (1.0, 1) and len(warm.log) > 3 * 3


def test_calibrate_fills_the_window_and_ignores_one_slow_try():
    clock = Clock()
    assert calibrate(Fake(clock, [1e-6]), 1e-3, clock) in range(800, 1300)
    # The first try after the warm-up is a hundred times too slow.
    assert calibrate(Fake(clock, [1e-6, 1e-3] + 100 * [1e-6]), 1e-3, clock) in range(800, 1300)


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


@pytest.mark.peers
@pytest.mark.parametrize("name", ("NumbaGather", "NumbaStrided"))
def test_numba_peers_compute_the_same_cloth(name):
    from peers import numba_peer

    check_peer(getattr(numba_peer, name), threads=1)


@pytest.mark.parametrize("cold_steps", [1, 20])
def test_nothing_is_run_between_pause_and_window(monkeypatch, cold_steps):
    seen = []
    start = works.paper(False, sphere=False)
    work = works.Paused(
        start, cold_steps, by="edge", precision="double", threads=1, instruction_set=cs.build_config()["instruction_set"]
    )

    def steps():
        return round((work.stepper.time - start.t) / PAPER_DT)

    def clock():
        seen.append(steps())
        return float(len(seen))

    monkeypatch.setattr(works.time, "sleep", lambda seconds: seen.append((seconds, steps())))
    measure([work], 2, 1e-3, clock)
    begin = [work.BEFORE + k * (work.BEFORE + cold_steps) for k in range(3)]
    windows = [[(0.05, b), b, b + cold_steps] for b in begin]
    assert seen == [windows[0][0], *windows[1], *windows[2]]


@pytest.mark.parametrize("make", [works.Core, works.StepCalls])
def test_cloth_is_put_back_before_it_has_moved_far(make):
    start = works.paper(False, sphere=False)
    work = make(start, by="gather", precision="double", threads=1, instruction_set=cs.build_config()["instruction_set"])
    work.run(3000)
    work.prepare()
    assert work.time == pytest.approx(start.t + 3000 * PAPER_DT)
    work.run(2000)
    work.prepare()
    assert work.time == start.t
    assert np.array_equal(work.positions, start.x)


@pytest.mark.parametrize("make", [works.Calls, works.Frames, works.StepCalls])
def test_a_step_a_call_is_the_same_steps(make, precision):
    options = {"by": "edge", "precision": precision, "threads": 1, "instruction_set": cs.build_config()["instruction_set"]}
    start = works.paper(True, sphere=True)
    one, other = works.Core(start, **options), make(start, **options)
    one.run(20)
    other.run(20)
    assert not np.array_equal(one.positions, start.x)
    assert np.array_equal(other.positions, one.positions)


class Failing(Work):
    """A peer that does not compile here."""

    def run(self, steps):
        raise RuntimeError("Failed in nopython mode pipeline\n" + 40 * "and so on\n")


def test_a_peer_that_fails_is_left_out_and_said_and_the_others_are_timed():
    figures = Figures()
    settings = replace(QUICK, windows=1, seconds=1e-5)
    run = candidates.Bench(settings, figures, ("edge",), ("sse2",), (1,), 1, lambda _: None)
    start = works.paper(True, False)
    labels = {"precision": "double", "threads": 1}
    core = run.core(start, by="edge", **labels)
    peer = run.peer(start, Failing, by="numba gather", **labels)
    candidates.run(run, [peer, core], error_steps=2)
    assert [figure.by for figure in figures] == ["edge"]
    (skipped,) = figures.skipped
    assert skipped["by"] == "numba gather" and skipped["work"] == start.name
    assert skipped["reason"] == "RuntimeError: Failed in nopython mode pipeline"
    # Of the core an error is one.
    with pytest.raises(RuntimeError, match="nopython"):
        candidates.run(run, [replace(peer, peer=False), core])
