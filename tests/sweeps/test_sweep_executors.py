"""Where a sweep is done: pools of threads and processes, and a Dask cluster that loses a worker."""

import itertools
import multiprocessing
import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import store
from clothsim.sweeps import sweep as sweeps
from clothsim.sweeps.grid import make_grid
from clothsim.sweeps.member import MemberMaker, SweepOptions
from clothsim.sweeps.metrics import choose_metrics
from clothsim.sweeps.sweep import Stopped, Task, Workers, deal_tasks, run_task

pytest.importorskip("xarray")

SCENE = cs.scenes.hanging(shape=(6, 7))
OVER = {
    "stiffness": np.geomspace(5e2, 5e3, 6),
    "dt": [1e-3, 3e-2],
    "precision": ["double", "single"],
}
METRICS = ["stable", "energy_drift", "error", "penetration"]


def sweep(**options):
    return cs.sweep(SCENE, OVER, duration=0.4, metrics=METRICS, progress=False, **options)


@pytest.fixture(scope="module")
def expected():
    return sweep(threads=1)


@pytest.fixture
def small_tasks(monkeypatch):
    """Make a task for every member, so that there are enough of them to go wrong."""
    monkeypatch.setattr(sweeps, "LARGEST_BATCH", 1)


@pytest.fixture
def member_log(monkeypatch):
    """Return indices of the members whose results came in, in order."""
    record = store.Results.take_records
    indices = []

    def recording(self, records):
        indices.extend(member.index for member in records)
        record(self, records)

    monkeypatch.setattr(store.Results, "take_records", recording)
    return indices


def check(result, expected, member_log):
    assert sorted(member_log) == list(range(24)), "nothing lost, nothing twice"
    for name in expected.data_vars:
        assert np.array_equal(
            result[name], expected[name], equal_nan=expected[name].dtype.kind == "f"
        )


def test_a_thread_pool(expected, small_tasks, member_log):
    with ThreadPoolExecutor(3) as pool:
        check(sweep(executor=pool), expected, member_log)
        assert pool.submit(int).result() == 0  # it is not ours to shut down
    assert set(expected.status.values.ravel().tolist()) == {1, 2}


@pytest.mark.parametrize("start", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # fork warns of threads
def test_a_process_pool(expected, small_tasks, member_log, start):
    if start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {start} on this system")
    cs.step(SCENE, SCENE.initial_position, SCENE.initial_velocity, 1e-3, 10, threads=2)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(start)) as pool:
        check(sweep(executor=pool), expected, member_log)


@pytest.mark.torture
def test_a_process_pool_that_breaks_leaves_a_store_to_go_on_with(
    expected, small_tasks, member_log, tmp_path, monkeypatch
):
    pytest.importorskip("zarr")
    path = tmp_path / "s.zarr"
    write = store.Results.write_to_store
    killed = []
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("fork")) as pool:

        def killing(self, final=False):
            write(self, final)
            if len(member_log) >= 4 and not killed:
                killed.append(next(iter(pool._processes)))
                os.kill(killed[0], signal.SIGKILL)
                # Or the other process might do what is left before it is noticed.
                while not pool._broken:
                    time.sleep(0.01)

        with monkeypatch.context() as patch, pytest.raises(BrokenProcessPool):
            patch.setattr(store.Results, "write_to_store", killing)
            sweep(executor=pool, store=path)
    assert 4 <= len(member_log) < 24
    assert int((cs.open_sweep(path).status > 0).sum()) == len(member_log)
    check(sweep(store=path), expected, member_log)


@pytest.mark.torture
def test_a_dask_cluster_that_loses_a_worker_half_way(
    expected, small_tasks, member_log, monkeypatch
):
    distributed = pytest.importorskip("distributed")
    killed = []
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=50,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        assert len(set(pids)) == 2 and os.getpid() not in pids

        def killing(self, final=False):
            if len(member_log) >= 12 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        monkeypatch.setattr(store.Results, "write_to_store", killing)
        result = sweep(executor=client)
        assert killed and client.status == "running"  # it is not ours to close
    check(result, expected, member_log)


def test_an_interrupt_keeps_what_is_finished(small_tasks, member_log, monkeypatch):
    """Tasks under way on our own threads stop, and hand over the members they have finished."""
    gathered, raised = [], []

    def interrupting(self, final=False):
        if len(member_log) >= 5 and not raised:
            raised.append(True)
            raise KeyboardInterrupt

        if final:
            gathered.append(self.members_to_run)

    monkeypatch.setattr(store.Results, "write_to_store", interrupting)
    with pytest.raises(
        KeyboardInterrupt, match=" of 24 members were done; give a store to keep them"
    ):
        sweep(threads=2)
    (pending,) = gathered
    assert sorted([*pending, *member_log]) == list(range(24)) and 0 < len(pending) < 24


def test_a_stopped_task_returns_its_finished_members():
    finished = []

    def pause():
        if finished:
            raise Stopped

    make = MemberMaker(SCENE, SweepOptions(0.05))
    members = [make(k, {"dt": dt}) for k, dt in enumerate((1e-3, 5e-4, 2e-4))]
    task = Task(members, choose_metrics({"seen": lambda run: finished.append(run) or 0.0}))
    assert [record.index for record in run_task(task, pause)] == [0]
    assert len(run_task(task)) == 3


def test_a_batch_stops_within_a_step_or_two_of_the_clock():
    calls = itertools.count(1)

    def pause():
        if next(calls) >= 4:
            raise Stopped

    make = MemberMaker(SCENE, SweepOptions(100.0, 1e-6))
    assert not run_task(Task([make(0, {}), make(1, {})], {}), pause)


# Tasks


def tasks_of(over, count=2, metrics="stable"):
    """Return the tasks of a sweep for an executor with `count` workers."""
    grid = make_grid(over)
    options = SweepOptions()
    with ThreadPoolExecutor(count) as pool:
        what = (
            MemberMaker(SCENE, options),
            grid,
            choose_metrics(metrics),
            options,
            np.arange(grid.size),
        )
        return grid, list(deal_tasks(*what, Workers(pool, None), {}))


def test_a_task_has_members_of_one_shape_and_method():
    over = {
        "mass": np.linspace(1, 2, 400),
        "scene": {str(n): cs.Scene(cs.Cloth((n, n))) for n in (4, 5)},
        "integrator": ["rk4", "velocity_verlet"],
    }
    grid, tasks = tasks_of(over)
    assert sorted(member.index for task in tasks for member in task.members) == list(
        range(grid.size)
    )
    assert max(len(task.members) for task in tasks) == 64 and len(tasks) == 4 * 7
    for task in tasks:
        assert (
            len(
                {
                    (member.scene.cloth.shape, member.settings["integrator"])
                    for member in task.members
                }
            )
            == 1
        )


def test_few_members_are_tasks_of_all_workers():
    assert (
        sorted(len(task.members) for task in tasks_of({"mass": np.linspace(1, 2, 60)}, 3)[1])
        == [5] * 12
    )
    assert len(tasks_of({"mass": [1.0, 2.0]}, 3)[1]) == 2


def test_members_of_one_reference_come_together():
    over = {"dt": [1e-3, 5e-4, 2e-4], "mass": np.linspace(1, 2, 32)}
    _, tasks = tasks_of(over, metrics="error")
    assert len(tasks) == 32
    for task in tasks:
        assert len({member.scene for member in task.members}) == 1


def test_a_member_is_made_once(monkeypatch):
    makes = []
    make = MemberMaker.__call__
    monkeypatch.setattr(
        MemberMaker, "__call__", lambda self, *args: makes.append(args[0]) or make(self, *args)
    )
    sweep()
    assert sorted(makes) == list(range(24))


def test_one_member_has_all_threads_and_many_have_one_each():
    default, explicit = Workers(None, None), Workers(None, 2)
    assert default.threads_per_task(1) is None and default.threads_per_task(5) == 1
    assert (
        explicit.threads_per_task(1) == 2
        and explicit.threads_per_task(2) == 1
        and explicit.count == 2
    )
    default.close()
    explicit.close()
    with ThreadPoolExecutor(5) as pool:
        pooled = Workers(pool, None)
        assert pooled.threads_per_task(1) == 1 and pooled.count == 5
