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
from clothsim.sweeps import results, workers
from clothsim.sweeps.grid import make_grid
from clothsim.sweeps.member import Member, Stopped, SweepOptions
from clothsim.sweeps.metrics import choose_metrics
from clothsim.sweeps.task import Batch, Task, TaskResult, run_task
from clothsim.sweeps.workers import Members, Planner, Workers

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
    for name in ("SHORTEST", "SHORTEST_HERE", "LONGEST"):
        monkeypatch.setattr(workers, name, 1e-9)


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


@pytest.mark.torture
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


@pytest.mark.torture
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


def test_running_members_are_kept_at_an_interrupt(small_tasks, recorded, monkeypatch):
    begun, go = threading.Event(), threading.Event()
    calls, started = itertools.count(), []

    def gated(task, pause):
        started.extend(task.values)
        if next(calls) == 0:
            assert begun.wait(20)
        else:
            begun.set()
            assert go.wait(20)
        return run_task(task)

    def interrupting(self, result):
        go.set()  # the other task, under way, ends after the interrupt
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "run_task", gated)
    monkeypatch.setattr(Planner, "learn", interrupting)
    with pytest.raises(KeyboardInterrupt, match=" of 24 members were done; give a store to keep them"):
        sweep(threads=2)
    assert sorted(recorded) == sorted(started) and 2 <= len(started) < 24


def stopping(calls):
    """A pause that stops its task at this call."""
    asked = itertools.count(1)

    def pause(cost):
        if next(asked) >= calls:
            raise Stopped

    return pause


def test_a_stopped_task_returns_its_finished_members():
    values = {k: {"dt": dt} for k, dt in enumerate((1e-3, 5e-4, 2e-4))}
    task = Task(SCENE, SweepOptions(0.05), values)
    result = run_task(task, stopping(2))
    assert result.stopped and [record.index for record in result.records] == [0]
    assert len(run_task(task).records) == 3


def test_a_batch_stops_within_a_step_or_two_of_the_clock():
    from tests.sweeps.test_sweep import member

    with pytest.raises(Stopped):
        Batch([member(SCENE, 1e-6, 100.0)], SweepOptions(), pause=stopping(4)).run()


# Tasks of a size

PLAIN = cs.Scene(cs.Cloth((6, 7), mass=2.5, stiffness=1e3, damping=0.1))


def planner(over, metrics, rate, count=2, duration=1.0):
    """As for an executor with `count` workers."""
    grid = make_grid(over)
    members = Members(PLAIN, grid, SweepOptions(duration, 1e-3, metrics=choose_metrics(metrics)))
    with ThreadPoolExecutor(count) as pool:
        made = Planner(members, np.arange(grid.size), Workers(pool, None))
    made.rate, made.known = rate, True
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
    assert sorted(index for task in tasks for index in task.values) == list(range(made.members.grid.size))
    seconds = [sum(cost(made, task)) * each for task in tasks]
    assert min(seconds) > 0.2 and [task.weight * each for task in tasks] == pytest.approx(seconds)


def cost(made, task):
    """Steps of mass points that the members of a task take, references and overheads included."""
    solved = set()
    for index, values in task.values.items():
        changes = dict(values)
        dt = changes.pop("dt", 1e-3)
        scene = PLAIN.replace(cloth=PLAIN.cloth.replace(**changes))
        limit = cs.max_stable_dt(scene)
        steps = 1.0 / dt if dt <= limit else min(1.0 / dt, 128)
        if made.members.references and made.members.grid.physics[index] not in solved:
            solved.add(made.members.grid.physics[index])
            # Four runs of dop853, each with half the step of the one before; a step costs three of RK4.
            steps += 3 * (1 + 2 + 4 + 8) * max(2 / limit, 8)
        yield steps * scene.cloth.rows * scene.cloth.columns + 1e4


@pytest.mark.parametrize("count", [2, 3])
def test_tasks_get_shorter_so_that_all_workers_end_together(count):
    made = planner({"stiffness": np.geomspace(100, 1000, 700)}, "stable", 1e-7, count)
    made.shortest = 0.05
    tasks = [task.weight * 1e-7 for task in made.tasks()]
    assert sum(tasks) == pytest.approx(700 * (1000 * 42 + 1e4) * 1e-7, rel=1e-9, abs=0)
    assert tasks[0] == pytest.approx(sum(tasks) / (2 * count), rel=0.02, abs=0)
    assert tasks[:-1] == sorted(tasks[:-1], reverse=True) and min(tasks) > 0.05
    assert tasks[-1] < 0.11 and len(tasks) < 12 * count
    busy = [0.0] * count
    for seconds in tasks:
        busy[busy.index(min(busy))] += seconds
    assert max(busy) - min(busy) < 0.11


def test_a_task_that_leaves_the_process_takes_no_made_members():
    (task,) = planner({"stiffness": [100.0, 200.0]}, "stable", 1e-7).tasks()
    assert sorted(task.made) == [0, 1] and pickle.loads(pickle.dumps(task)).made == {}
    assert pickle.loads(pickle.dumps(task)).values == task.values


def test_a_member_is_made_once(monkeypatch):
    """In one process each is made for the check and kept for its run; large members are made again."""
    made, make = [], Member.make.__func__
    monkeypatch.setattr(Member, "make", classmethod(lambda cls, *args: made.append(args[0]) or make(cls, *args)))
    sweep()
    assert sorted(made) == list(range(24))
    monkeypatch.setattr(workers, "_POINTS_KEPT", 42 * 4)
    made.clear()
    sweep()
    assert sorted(made) == sorted([*range(24), *range(4, 24)])


def test_costs_are_estimated_for_a_large_grid():
    """Members along each axis are made; the product of their costs is that of each member."""
    over = {"dt": np.geomspace(1e-4, 1e-3, 60), "shape": [(4, 4), (8, 8)], "stiffness": np.linspace(100, 200, 50)}
    members = planner(over, "stable", 1e-7).members
    expected = np.multiply.outer(1 / over["dt"], [16.0, 64.0])[..., None] + np.zeros(50)
    assert members.weights.reshape(expected.shape) - 1e4 == pytest.approx(expected, rel=1e-9)


def test_tasks_learn_from_how_long_they_took():
    made = planner({"stiffness": np.geomspace(100, 1000, 4000)}, "stable", 1e-7)
    tasks = made.tasks()
    first = next(tasks)
    for _ in range(30):
        made.learn(TaskResult((), 10 * first.weight * 1e-7, first.weight, "here", "sse2"))
    next(tasks)  # was cut before
    assert next(tasks).weight == pytest.approx(first.weight / 10, rel=0.05)
    before = made.rate
    made.learn(TaskResult((), 0.001, first.weight, "here", "sse2", stopped=True))
    assert made.rate == before
    made.known = False  # what was guessed at the start weighs nothing
    made.learn(TaskResult((), 7.0, 2.0, "here", "sse2"))
    assert made.rate == 3.5


def test_members_of_one_reference_come_in_one_task():
    made = planner({"dt": [1e-3, 5e-4, 2e-4], "mass": np.linspace(1, 2, 30)}, "error", 1e-7)
    for task in made.tasks():
        assert len(task.values) == 3 * len({made.members.grid.physics[index] for index in task.values})


def test_one_small_task_has_all_threads_and_many_have_one_each():
    alone, given = Workers(None, None), Workers(None, 2)
    assert alone.threads_of(1) is None and alone.threads_of(5) == 1
    assert given.threads_of(1) == 2 and given.threads_of(2) == 1 and given.limit() == 4
    alone.close()
    given.close()
    with ThreadPoolExecutor(5) as pool:
        others = Workers(pool, None)
        assert others.threads_of(1) == 1 and others.limit() == 10
    members = Members(PLAIN, make_grid(None), SweepOptions(1e4, 1e-3))
    alone = Workers(None, None)
    assert Planner(members, np.arange(1), alone).threads is None  # a single member is a single task
    alone.close()
