"""Files of the package: whole or not at all, and damage is seen."""

import errno
import os
import re
import resource
import shutil
import threading
import warnings

import clothsim as cs
import numpy as np
import pytest
from clothsim.base import files

SCENE = cs.Scene(cs.Cloth((3, 3)), cs.Sphere((0.5, -0.5, 0.5), 0.1))
RUN = cs.simulate(SCENE, 0.003, dt=1e-3, every=1)

# Each way to write a file, and its name.
WRITERS = {
    "scene.toml": lambda path: cs.save_scene(SCENE, path),
    "run.npz": RUN.save,
    "snapshot.npz": lambda path: cs.Stepper(SCENE).snapshot().save(path),
    "page.html": RUN.to_html,
    "live.html": cs.Scene(SCENE.cloth).to_live_html,
    "picture.png": lambda path: RUN.picture(path=path),
    "film.gif": RUN.animate,
    "film.mp4": RUN.animate,
    "cloth.glb": RUN.export,
    "cloth.usdc": RUN.export,
    "cloth.pc2": RUN.export,
    "cloth.pvd": RUN.export,
}


def write(name, path):
    """Write the file `name` as `path`; skip where its writer's program or package is missing."""
    if name == "film.mp4" and not shutil.which("ffmpeg"):
        pytest.importorskip("imageio_ffmpeg")
    try:
        WRITERS[name](path)
    except ImportError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file_and_no_part(name, tmp_path):
    path = tmp_path / name
    write(name, path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    most, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before[name]) // 2, hard))
    try:
        with pytest.raises(Exception) as caught:  # libraries and ffmpeg raise their own
            WRITERS[name](path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    if isinstance(caught.value, OSError) and caught.value.errno == errno.EFBIG:
        assert str(caught.value).endswith(f"{str(path)!r}")
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", WRITERS)
def test_a_missing_folder_is_named_before_any_work(name, tmp_path):
    with pytest.raises(
        (ValueError, FileNotFoundError),
        match=f"^path must be in an existing folder, got '.*none/{name}'",
    ):
        write(name, tmp_path / "none" / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", WRITERS)
def test_a_symbolic_link_is_replaced_and_not_followed(name, tmp_path):
    other = tmp_path / "other"
    other.write_text("mine")
    path = tmp_path / name
    path.symlink_to(other)
    write(name, path)
    assert other.read_text() == "mine"
    assert path.is_file() and not path.is_symlink()


@pytest.mark.parametrize("name", ["scene.toml", "run.npz", "page.html"])
def test_threads_that_save_to_one_path_leave_one_whole_file(name, tmp_path):
    path, failed = tmp_path / name, []
    write(name, path)
    load = {
        "scene.toml": cs.load_scene,
        "run.npz": cs.load_run,
        "page.html": lambda path: path.read_bytes(),
    }[name]
    expected = load(path)

    def save():
        try:
            for _ in range(6):
                WRITERS[name](path)
                assert load(path) == expected
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=save) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    assert [file.name for file in tmp_path.iterdir()] == [name]


# Damage


def flips(data, count):
    """Return the file with one bit changed, at up to `count` bytes spread over the file."""
    for place in np.unique(np.linspace(0, len(data) - 1, count).astype(int)):
        changed = bytearray(data)
        changed[place] ^= 1 << (int(place) * 5 + 3) % 8
        yield f"byte {place}", bytes(changed)


def cuts(data, count):
    """Return the file cut after up to `count` lengths."""
    for length in np.unique(np.linspace(0, len(data) - 1, count).astype(int)):
        yield f"cut at {length}", data[:length]


RESUMED = RUN.resume(0.001)
SAVED = {
    "run.npz": (cs.load_run, lambda run: run == RUN and run.resume(0.001) == RESUMED),
    "snapshot.npz": (
        cs.Snapshot.load,
        lambda one: one.scene == SCENE and cs.Stepper.restore(one).time == 0,
    ),
}


@pytest.mark.parametrize("name", SAVED)
def test_damage_is_a_value_error_with_the_path_or_harmless(name, tmp_path):
    """A changed byte that no reader uses, as a time in the archive, is harmless."""
    load, equal = SAVED[name]
    path = tmp_path / name
    WRITERS[name](path)
    data, loaded = path.read_bytes(), []
    count = int(os.environ.get("CLOTHSIM_TEST_FLIPS", "1500"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zipfile warns of names that occur twice
        for what, damaged in (*flips(data, count), *cuts(data, count // 4)):
            path.write_bytes(damaged)
            try:
                found = load(path)
            except ValueError as error:
                assert str(error).startswith(str(path)), what
            else:
                assert equal(found), what
                loaded.append(what)
    assert len(loaded) < count  # how many bytes nothing reads depends on the sizes of the headers


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"x": RUN.x[:, :2]},
            r"x must be float64 of shape \(4, 3, 3, 3\), got float64 of shape \(4, 2, 3, 3\)",
        ),
        ({"x": np.where(RUN.x == RUN.x[1, 1, 1], np.nan, RUN.x)}, "x must be finite numbers"),
        ({"scene": '{"schema": 2, "cloth": {"shape": [3, 4]}}'}, r"shape \(4, 3, 4, 3\)"),
    ],
)
def test_arrays_that_do_not_fit_the_scene_are_refused(change, words, tmp_path):
    arrays = files.read_npz(RUN.save(tmp_path / "run"), "run", ())
    path = files.write_npz(tmp_path / "run.npz", {**arrays, **change})
    with pytest.raises(
        ValueError, match=f"^{re.escape(str(path))} is no run of clothsim: .*{words}"
    ):
        cs.load_run(path)
