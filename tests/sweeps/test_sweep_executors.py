"""Where a sweep is done: pools of threads and processes, and a Dask cluster that loses a worker."""

import itertools
import multiprocessing
import os
import pickle
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import batch, planning, results
from clothsim.sweeps import workers as engine
from clothsim.sweeps.grid import make_grid
from clothsim.sweeps.member import Members, Settings
from clothsim.sweeps.metrics import choose_metrics
from clothsim.sweeps.planning import Planner
from clothsim.sweeps.task import Task, TaskResult, run_task

pytest.importorskip("xarray")

SCENE = cs.scenes.hanging(shape=(6, 7))
OVER = {"stiffness": np.geomspace(5e2, 5e3, 6), "dt": [1e-3, 3e-2], "precision": ["double", "single"]}
METRICS = ["stable", "energy_drift", "error", "penetration"]


def sweep(**options):
    return cs.sweep(SCENE, OVER, duration=0.4, metrics=METRICS, progress=False, **options)


@pytest.fixture(scope="module")
def expected():
    return sweep(threads=1)


@pytest.fixture
def small_tasks(monkeypatch):
    """A task for about every member, so that there are enough of them to go wrong."""
    monkeypatch.setattr(planning, "SHORTEST", 1e-9)
    monkeypatch.setattr(planning, "SHORTEST_HERE", 1e-9)
    monkeypatch.setattr(planning, "LONGEST", 1e-9)


@pytest.fixture
def recorded(monkeypatch):
    """Indices of the members whose results came in, in order."""
    record, indices = results.Results.record, []

    def recording(self, one):
        indices.append(one.index)
        record(self, one)

    monkeypatch.setattr(results.Results, "record", recording)
    return indices


def check(result, expected, recorded):
    assert sorted(recorded) == list(range(24)), "nothing lost, nothing twice"
    for name in expected.data_vars:
        assert np.array_equal(result[name], expected[name], equal_nan=expected[name].dtype.kind == "f")


def test_threads_of_this_process(expected, small_tasks, recorded):
    check(sweep(threads=3), expected, recorded)
    assert set(expected.status.values.ravel().tolist()) == {1, 2}


def test_a_thread_pool(expected, small_tasks, recorded):
    with ThreadPoolExecutor(3) as pool:
        check(sweep(executor=pool), expected, recorded)
        assert pool.submit(int).result() == 0  # it is not ours to shut down


@pytest.mark.parametrize("start", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # fork with threads about
def test_a_process_pool(expected, small_tasks, recorded, start):
    if start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {start} on this system")
    cs.step(SCENE, SCENE.initial_position, SCENE.initial_velocity, 1e-3, 10, threads=2)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(start)) as pool:
        check(sweep(executor=pool), expected, recorded)


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_process_pool_that_breaks_leaves_a_store_to_go_on_with(expected, small_tasks, recorded, tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    path = tmp_path / "s.zarr"
    learn, killed = Planner.learn, []
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork")) as pool:

        def killing(self, result):
            learn(self, result)
            if len(recorded) >= 4 and not killed:
                killed.append(next(iter(pool._processes)))
                os.kill(killed[0], signal.SIGKILL)
                while not pool._broken:  # or the other process might do what is left before it is noticed
                    time.sleep(0.01)

        with monkeypatch.context() as patch, pytest.raises(BrokenProcessPool):
            patch.setattr(Planner, "learn", killing)
            sweep(executor=pool, store=path)
    assert 4 <= len(recorded) < 24
    assert int((cs.open_sweep(path).status > 0).sum()) == len(recorded)
    check(sweep(store=path), expected, recorded)


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_dask_cluster_that_loses_a_worker_half_way(expected, small_tasks, recorded, monkeypatch):
    distributed = pytest.importorskip("distributed")
    learn, killed = Planner.learn, []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        assert len(set(pids)) == 2 and os.getpid() not in pids

        def killing(self, result):
            learn(self, result)
            if len(recorded) >= 12 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        monkeypatch.setattr(Planner, "learn", killing)
        result = sweep(executor=client)
        assert killed and client.status == "running"  # it is not ours to close
    check(result, expected, recorded)


def test_an_interrupt_keeps_what_is_finished(small_tasks, recorded, monkeypatch):
    """Tasks under way on our own threads stop, and hand over the members they have finished."""
    learn, gathered = Planner.learn, []

    def interrupting(self, result):
        learn(self, result)
        if len(recorded) >= 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(Planner, "learn", interrupting)
    close = results.Results.close
    monkeypatch.setattr(results.Results, "close", lambda self: gathered.append(self.pending) or close(self))
    with pytest.raises(KeyboardInterrupt):
        sweep(threads=2)
    (pending,) = gathered
    assert sorted([*pending, *recorded]) == list(range(24)) and 0 < len(pending) < 24


def test_what_runs_at_an_interrupt_is_kept(small_tasks, recorded, monkeypatch):
    run_task, begun, go = engine.run_task, threading.Event(), threading.Event()
    calls, started = itertools.count(), []

    def gated(task, stopped=None):
        started.extend(index for index, _ in task.members)
        if next(calls) == 0:
            assert begun.wait(20)
        else:
            begun.set()
            assert go.wait(20)
        return run_task(task)

    def interrupting(self, result):
        go.set()  # the other task, under way, ends after the interrupt
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "run_task", gated)
    monkeypatch.setattr(Planner, "learn", interrupting)
    with pytest.raises(KeyboardInterrupt):
        sweep(threads=2)
    assert sorted(recorded) == sorted(started) and 8 <= len(started) < 24


def test_a_task_that_is_stopped_hands_over_what_it_has():
    settings = Settings(0.05, None, "rk4", "double", "auto", False, None, False, 32, ())
    members = tuple((k, {"dt": dt}) for k, dt in enumerate((1e-3, 5e-4, 2e-4)))
    asked = itertools.count()
    result = run_task(Task(SCENE, settings, members), lambda: next(asked) >= 1)
    assert result.stopped and [record.index for record in result.records] == [0]
    assert len(run_task(Task(SCENE, settings, members)).records) == 3


def test_a_batch_stops_within_a_step_or_two_of_the_clock():
    from tests.sweeps.test_sweep import member

    asked = []

    def stopped():
        asked.append(True)
        return len(asked) > 3

    with pytest.raises(batch.Stopped):
        batch.run_batch([member(SCENE, 1e-6, 100.0)], frozenset(), stopped=stopped)


# Tasks of a size

PLAIN = cs.Scene(cs.Cloth((6, 7), mass=2.5, stiffness=1e3, damping=0.1))


def planner(over, metrics, seconds_per_weight, workers=2, duration=1.0, shortest=None):
    settings = Settings(duration, 1e-3, "rk4", "double", "auto", False, None, False, 32, choose_metrics(metrics))
    grid = make_grid(over)
    members = Members(PLAIN, grid, settings)
    made = Planner(members, np.arange(grid.size), workers, shortest=shortest)
    made.seconds_per_weight = seconds_per_weight
    return made


@pytest.mark.parametrize(
    ("over", "metrics"),
    [
        ({"stiffness": np.geomspace(100, 1000, 500)}, "stable"),
        ({"mass": np.linspace(1, 2, 40), "dt": [1e-3, 1e-4, 1e-5]}, "stable"),
        ({"shape": [(4, 4), (8, 8), (40, 40)], "mass": np.linspace(1, 2, 100)}, "stable"),
        ({"stiffness": np.geomspace(100, 1e6, 2000)}, "stable"),  # most diverge early
        ({"mass": np.linspace(1, 2, 60), "dt": [1e-3, 1e-4]}, "error"),
    ],
)
def test_tasks_take_at_least_a_fifth_of_a_second(over, metrics):
    each = 1e-7  # s per step of a mass point
    made = planner(over, metrics, each)
    tasks = list(made.tasks())
    assert len(tasks) > 1
    assert sorted(index for task in tasks for index, _ in task.members) == list(range(made.grid.size))
    seconds = [sum(cost(made, task)) * each for task in tasks]
    assert min(seconds) > 0.2 and [task.weight * each for task in tasks] == pytest.approx(seconds)


def cost(made, task):
    """Steps of mass points that the members of a task take, references included."""
    solved = set()
    for index, values in task.members:
        changes = dict(values)
        dt = changes.pop("dt", 1e-3)
        scene = PLAIN.replace(cloth=PLAIN.cloth.replace(**changes))
        limit = cs.max_stable_dt(scene)
        steps = 1.0 / dt if dt <= limit else min(1.0 / dt, 128)
        if made.references and made.grid.physics[index] not in solved:
            solved.add(made.grid.physics[index])
            # Four runs of dop853, each with half the step of the one before; a step costs three of RK4.
            steps += 3 * (1 + 2 + 4 + 8) * max(2 / limit, 8)
        yield steps * scene.cloth.rows * scene.cloth.columns


@pytest.mark.parametrize("workers", [2, 3])
def test_tasks_get_shorter_so_that_all_workers_end_together(workers):
    over = {"stiffness": np.geomspace(100, 1000, 800)}
    made = planner(over, "stable", 1e-7, workers, shortest=0.05)
    tasks = [task.weight * 1e-7 for task in made.tasks()]
    assert sum(tasks) == pytest.approx(800 * 1000 * 42 * 1e-7, rel=1e-9, abs=0)
    assert tasks[0] == pytest.approx(sum(tasks) / (2 * workers), rel=0.02, abs=0)
    assert tasks[:-1] == sorted(tasks[:-1], reverse=True) and min(tasks) > 0.05
    assert tasks[-1] < 0.11 and len(tasks) < 12 * workers
    busy = [0.0] * workers
    for seconds in tasks:
        busy[busy.index(min(busy))] += seconds
    assert max(busy) - min(busy) < 0.11


def test_a_task_that_leaves_the_process_takes_no_made_members():
    made = planner({"stiffness": [100.0, 200.0]}, "stable", 1e-7)
    (task,) = made.tasks()
    assert sorted(task.made) == [0, 1] and pickle.loads(pickle.dumps(task)).made == {}
    assert pickle.loads(pickle.dumps(task)).members == task.members
    with ThreadPoolExecutor(1) as pool:
        assert engine.Workers(pool, None).shortest_task == planning.SHORTEST > 0.2


def test_few_made_members_are_kept():
    grid = make_grid({"stiffness": np.geomspace(100, 1000, 5), "shape": [(4, 4), (1100, 1000)]})
    settings = Settings(1.0, 1e-3, "rk4", "double", "auto", False, None, False, 32, ())
    members = Members(PLAIN, grid, settings)
    for index in range(grid.size):
        assert members.make(index).index == index
    kept = [index for index in range(grid.size) if members.take(index) is not None]
    assert kept == [0, 1, 2, 4, 6, 8]  # two large ones would be more than there is room for
    assert members.take(0) is None
    assert members.make(3) is members.make(3)  # there is room again


def test_tasks_learn_from_how_long_they_took():
    made = planner({"stiffness": np.geomspace(100, 1000, 4000)}, "stable", 1e-7)
    tasks = made.tasks()
    first = next(tasks)
    for _ in range(30):
        made.learn(TaskResult((), 10 * first.weight * 1e-7, first.weight, "here", "sse2"))
    next(tasks)  # was cut before
    assert next(tasks).weight == pytest.approx(first.weight / 10, rel=0.05)
    before = made.seconds_per_weight
    made.learn(TaskResult((), 0.001, first.weight, "here", "sse2", stopped=True))
    assert made.seconds_per_weight == before


def test_members_that_share_a_reference_share_a_task():
    made = planner({"dt": [1e-3, 5e-4, 2e-4], "mass": np.linspace(1, 2, 30)}, "error", 1e-7)
    for task in made.tasks():
        places = {made.grid.physics[index] for index, _ in task.members}
        assert len(task.members) == 3 * len(places)


def test_one_small_task_has_all_threads_and_many_have_one_each():
    alone = engine.Workers(None, None)
    assert alone.threads_of(1) is None and alone.threads_of(5) == 1
    alone.close()
    given = engine.Workers(None, 2)
    assert given.threads_of(1) == 2 and given.threads_of(2) == 1 and given.limit() == 4
    given.close()
    with ThreadPoolExecutor(5) as pool:
        others = engine.Workers(pool, None)
        assert others.threads_of(1) == 1 and others.limit() == 10
