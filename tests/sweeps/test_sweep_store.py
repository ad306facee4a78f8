"""Stores: resumed after any end, refused where they differ, with provenance."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import store
from clothsim.sweeps import sweep as sweeps
from tables import each

xarray = pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")

SCENE = cs.scenes.hanging(shape=(6, 7))
OVER = {"stiffness": [1e3, 2e3, 3e3], "dt": [1e-3, 2e-2], "precision": ["double", "single"]}
SMALL = {"dt": [1e-3, 2e-2]}
METRICS = ["stable", "energy_drift", "error"]


def sweep(path, over=OVER, scene=SCENE, **options):
    options = {"duration": 0.3, "metrics": METRICS, **options}
    return cs.sweep(scene, over, store=path, progress=False, **options)


def height(run):
    return run.x[..., 1].mean(axis=(1, 2))


def same(a, b):
    assert set(a.variables) == set(b.variables)
    for name in a.variables:
        left = a[name].values
        right = b[name].values
        assert left.dtype == right.dtype, name
        assert np.array_equal(left, right, equal_nan=left.dtype.kind == "f"), name
        assert a[name].dims == b[name].dims and a[name].attrs == b[name].attrs, name


@pytest.fixture(scope="module")
def store_path(tmp_path_factory):
    """Return a store that nothing changes."""
    path = tmp_path_factory.mktemp("stores") / "s.zarr"
    sweep(path)
    return path


@pytest.fixture
def member_log(monkeypatch):
    """Return indices of the members that are run, in order; each task has a single member."""
    run_task = sweeps.run_task
    indices = []

    def counting(task, **options):
        indices.extend(member.index for member in task.members)
        return run_task(task, **options)

    monkeypatch.setattr(sweeps, "run_task", counting)
    monkeypatch.setattr(sweeps, "LARGEST_BATCH", 1)
    monkeypatch.setattr(store.Store, "write_is_due", True)
    return indices


@pytest.mark.filterwarnings("error")
def test_a_store_holds_the_results_of_memory(tmp_path):
    options = {"every": 0.07, "metrics": [*METRICS, height]}
    result = sweep(tmp_path / "s.zarr", **options)
    same(result, cs.sweep(SCENE, OVER, duration=0.3, progress=False, **options))
    same(result, cs.open_sweep(tmp_path / "s.zarr"))
    dataset = xarray.open_zarr(tmp_path / "s.zarr", chunks=None, consolidated=False)
    assert (
        np.array_equal(dataset.error, result.error, equal_nan=True)
        and dataset.stiffness.attrs["units"] == "N/m"
    )
    assert result.height.dims == ("stiffness", "dt", "precision", "height_0")
    assert (
        np.isnan(result.height.sel(dt=2e-2)).all() and np.isfinite(result.height.sel(dt=1e-3)).all()
    )


def test_provenance(tmp_path):
    result = sweep(tmp_path / "s.zarr")
    about = result.clothsim.provenance
    assert result.clothsim.scene == SCENE
    assert about["identity"]["version"] == cs.__version__
    assert about["identity"]["over"][1]["values"]["dt"] == OVER["dt"]
    assert about["build"]["instruction_set"] == cs.build_config()["instruction_set"]
    assert about["machine"]["cpu"] and about["created"]
    assert (
        json.loads(result.attrs["clothsim_sweep"])
        == about
        == sweep(tmp_path / "s.zarr").clothsim.provenance
    )


class Killed(BaseException):
    pass


def killed(monkeypatch, after, run):
    """Run with writes to the disk, file by file, that end after so many, as with a power cut;
    whether they ended.
    """
    from zarr.storage import _local

    writes = []
    write = _local._put

    def writing(*args, **options):
        writes.append(args)
        if len(writes) > after:
            raise Killed
        return write(*args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(_local, "_put", writing)
        try:
            run()
        except Killed:
            return True
    return False


def test_a_store_that_is_killed_between_two_writes_is_whole(tmp_path, member_log, monkeypatch):
    expected = cs.sweep(SCENE, SMALL, duration=0.3, metrics="energy_drift", progress=False)
    readable = []
    after = 0
    is_over = False
    while not is_over:
        path = tmp_path / f"{after}.zarr"
        is_over = not killed(monkeypatch, after, lambda: sweep(path, SMALL, metrics="energy_drift"))
        is_done = np.zeros(2, bool)
        try:
            before = cs.open_sweep(path)
        except ValueError as error:
            assert (
                "stopped before it had anything" in str(error)
                or "no store" in str(error)
                or "folder" in str(error)
            )
        else:
            is_done = before.status.values > 0
            for name in ("energy_drift", "unstable_step", "max_stable_dt"):
                left = before[name].values[is_done]
                right = expected[name].values[is_done]
                assert np.array_equal(left, right, equal_nan=True)
        readable.append(is_done.sum())
        member_log.clear()
        same(sweep(path, SMALL, metrics="energy_drift"), expected)
        assert len(member_log) == 2 - int(is_done.sum())
        after += 7
    assert readable == sorted(readable) and set(readable) == {0, 1, 2}


def test_a_second_ctrl_c_waits_until_the_store_is_written(tmp_path, member_log, monkeypatch):
    write = store.Store.write_values
    signals = []

    def interrupted(self, dataset):
        signals.append(signal.raise_signal(signal.SIGINT))
        write(self, dataset)

    def advance(self, count):
        monkeypatch.setattr(store.Store, "write_values", interrupted)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(store.Store, "write_is_due", False)
    monkeypatch.setattr(sweeps.ProgressBar, "advance", advance)
    path = tmp_path / "s.zarr"
    with pytest.raises(KeyboardInterrupt) as caught:
        sweep(path)
    monkeypatch.undo()
    is_done = cs.open_sweep(path).status.values > 0
    assert len(signals) == 1 and 1 <= is_done.sum() < is_done.size
    assert f"{is_done.sum()} of {is_done.size} members are in" in str(caught.value)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@each(
    "change, names",
    [
        ({"scene": SCENE.replace(gravity=(0, -1.62, 0))}, ["scene.gravity.1", "-9.80665", "-1.62"]),
        ({"over": {**OVER, "dt": [1e-3, 3e-2]}}, ["over.1.values.dt.1", "0.02", "0.03"]),
        ({"over": {**OVER, "dt": [1e-3]}}, ["over.1.values.dt"]),
        ({"over": {"dt": OVER["dt"]}}, ["over"]),
        ({"duration": 0.2}, ["settings.duration"]),
        ({"metrics": ["stable"]}, ["settings.metrics"]),
        ({"kernel": "gather"}, ["settings.kernel"]),
    ],
)
def test_a_store_of_another_sweep_is_refused(store_path, change, names):
    before = {p: p.read_bytes() for p in store_path.rglob("*") if p.is_file()}
    with pytest.raises(ValueError, match="of another sweep; it differs in") as caught:
        sweep(store_path, **change)
    for name in names:
        assert name in str(caught.value)
    assert before == {p: p.read_bytes() for p in store_path.rglob("*") if p.is_file()}


def test_a_store_of_another_version_is_refused(store_path, monkeypatch):
    monkeypatch.setattr(sweeps, "build_config", lambda: {"version": "99.0"})
    difference = re.escape(f'version ("{cs.__version__}" in the store, "99.0" given)')
    with pytest.raises(ValueError, match=difference):
        sweep(store_path)
    monkeypatch.setattr(store, "SCHEMA", 6)
    with pytest.raises(ValueError, match="schema 5, the version read here is 6"):
        sweep(store_path)


def test_a_large_array_that_differs_is_seen(tmp_path):
    masses = np.full((6, 7), 0.1)
    sweep(tmp_path / "s.zarr", {"mass": {"even": masses}}, dt=1e-3)
    masses[3, 3] = 0.2
    with pytest.raises(ValueError, match="over"):
        sweep(tmp_path / "s.zarr", {"mass": {"even": masses}}, dt=1e-3)


def test_a_folder_that_is_no_store_is_refused_and_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="no store of a sweep"):
        sweep(tmp_path)
    with pytest.raises(ValueError, match="no store of a sweep"):
        cs.open_sweep(tmp_path)
    with pytest.raises(ValueError, match="folder"):
        cs.open_sweep(tmp_path / "nothing")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


WRITER = """
import sys, time
import clothsim as cs

def wait(run):
    print("writing", flush=True)
    time.sleep(60)
    return 0.0

scene = cs.scenes.hanging(shape=(6, 7))
cs.sweep(scene, {"mass": [1.0]}, dt=1e-3, metrics=wait, store=sys.argv[1], progress=False)
"""


@pytest.mark.skipif(os.name != "posix", reason="locks")
def test_one_writer_at_a_time(tmp_path):
    path = tmp_path / "poetry"
    (tmp_path / "poetry.lock").write_text("mine")
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout.readline() == "writing\n"
        with pytest.raises(
            ValueError, match="poetry' is being written by a sweep; wait for its end"
        ):
            sweep(path, {"mass": [1.0]}, dt=1e-3)
        writer.kill()
    # The lock of a dead process is taken over, and nothing lies beside the store.
    with pytest.raises(ValueError, match="of another sweep"):
        sweep(path)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["poetry", "poetry.lock"]
    assert (tmp_path / "poetry.lock").read_text() == "mine"
    shutil.rmtree(path)
    sweep(path)
    about = json.loads(cs.open_sweep(path).attrs[store.ATTRIBUTE])
    writing = store.Store(path, about)  # this holds for two threads of one process too
    (tmp_path / "link.zarr").symlink_to(path)
    for file in (path, tmp_path / "link.zarr"):
        with pytest.raises(ValueError, match=f"{file.name}' is being written by a sweep; "):
            sweep(file)
    writing.release_lock()
    sweep(path)


def test_members_that_failed_are_tried_again(tmp_path, member_log):
    failing = [True]

    def delicate(run):
        if failing[0] and run.scene.cloth.mass == 2.0:
            raise RuntimeError("once")
        return run.x[-1].mean(axis=(0, 1))

    over = {"mass": [1.0, 2.0, 3.0]}
    with pytest.warns(RuntimeWarning, match="1 of 3 members failed.*once"):
        first = sweep(tmp_path / "s.zarr", over, dt=1e-3, metrics=delicate)
    assert first.status.values.tolist() == [1, 3, 1]
    failing[0] = False
    member_log.clear()
    second = sweep(tmp_path / "s.zarr", over, dt=1e-3, metrics=delicate)
    assert member_log == [1] and second.status.values.tolist() == [1, 1, 1]
    assert second.delicate.dims == ("mass", "delicate_0") and np.isfinite(second.delicate).all()
    assert np.array_equal(first.delicate[::2], second.delicate[::2])
