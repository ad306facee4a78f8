"""Stores that are damaged: named, never handed on, and computed again."""

import random
import shutil

import clothsim as cs
import numpy as np
import pytest
from clothsim.sweeps import stored

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from tests.sweeps.test_sweep_store import killed, same

SCENE = cs.Scene(cs.Cloth((3, 3), mass=1.0, stiffness=50.0, damping=0.1))
OVER = {"stiffness": [50.0, 60.0], "springs": [("structural",), ("structural", "shear")]}


def tip(run):
    return run.x[-1, -1, -1]


def sweep(path, **options):
    options = {"frames": True, "every": 0.01, "metrics": ["stable", "energy_drift", tip], **options}
    return cs.sweep(SCENE, OVER, duration=0.02, dt=1e-3, store=path, progress=False, **options).load()


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The folder of a store, and what is in it."""
    path = tmp_path_factory.mktemp("store") / "s.zarr"
    return path, sweep(path)


def files(path):
    return sorted(file.relative_to(path).as_posix() for file in path.rglob("*") if file.is_file())


def seen(path):
    """The damaged files that reading finds."""
    attrs, found = stored.read_attrs(path)
    return set(stored.find_damage(path, attrs, found).files)


def flips(data, most, seed):
    """Places of bytes and their flipped values."""
    rng = random.Random(seed)
    places = range(len(data)) if most is None else rng.sample(range(len(data)), min(most, len(data)))
    return [(place, data[place] ^ 1 << rng.randrange(8)) for place in places]


@pytest.mark.parametrize("most", [6, pytest.param(100, marks=pytest.mark.slow)])
def test_a_flipped_bit_of_any_file_is_named(sound, tmp_path, most):
    path = tmp_path / "s.zarr"
    shutil.copytree(sound[0], path)
    assert seen(path) == set() and len(files(path)) > 30
    for name in files(path):
        data = (path / name).read_bytes()
        for place, value in flips(data, most, name):
            (path / name).write_bytes(data[:place] + bytes([value]) + data[place + 1 :])
            assert name in seen(path), (name, place, value)
        (path / name).write_bytes(data)


def test_a_flipped_bit_of_every_byte_of_every_chunk_is_seen(sound):
    chunks = [sound[0] / name for name in files(sound[0]) if not name.endswith("zarr.json")]
    assert len(chunks) > 15
    for chunk in chunks:
        data = chunk.read_bytes()
        assert stored.checks(data)
        for place, value in flips(data, None, chunk.name):
            assert not stored.checks(data[:place] + bytes([value]) + data[place + 1 :]), (chunk, place, value)


KINDS = ("flipped", "cut", "deleted", "empty")


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 3))])
def test_a_damaged_file_is_named_and_its_members_are_computed_again(sound, tmp_path, first):
    """Each file is damaged in one way; the slow tests do the other ways."""
    path, expected = tmp_path / "s.zarr", sound[1]
    shutil.copytree(sound[0], path)
    for k, name in enumerate(files(path)):
        file, kind = path / name, KINDS[(k + first) % 4]
        data = file.read_bytes()
        ((place, value),) = flips(data, 1, k)
        damaged = {"flipped": data[:place] + bytes([value]) + data[place + 1 :], "cut": data[:-1], "empty": b""}
        file.unlink()
        if kind in damaged:
            file.write_bytes(damaged[kind])
        with pytest.raises(ValueError, match=rf"is damaged, see {name}.*repeat the call of sweep"):
            cs.open_sweep(path)
        with pytest.warns(RuntimeWarning, match=rf"is damaged, see {name}.* of 4 members, which are computed again"):
            same(sweep(path), expected)
    same(cs.open_sweep(path).load(), expected)


def test_only_lost_members_are_computed_again(sound, tmp_path):
    path = tmp_path / "s.zarr"
    shutil.copytree(sound[0], path)
    for name, members in (("velocity/c/1/0/0/0/0/0", 1), ("springs/c/0", 0), ("sessions/c", 0), ("stable/c/0/0", 4)):
        (path / name).unlink()
        with pytest.warns(RuntimeWarning, match=f"this concerns {members} of 4 members"):
            result = sweep(path)
        session = result.clothsim.provenance["sessions"][-1]
        assert (session["tasks"] > 0) == (members > 0) and session["members_finished"] == 4


def test_frames_that_are_not_read_at_opening_are_refused_at_their_use(sound, tmp_path, monkeypatch):
    path = tmp_path / "s.zarr"
    shutil.copytree(sound[0], path)
    monkeypatch.setattr(stored, "_FRAMES_CHECKED", 0)
    file = path / "position/c/0/0/0/0/0/0"
    data = file.read_bytes()
    file.write_bytes(data[:20] + bytes([data[20] ^ 1]) + data[21:])
    opened = cs.open_sweep(path)
    assert np.isfinite(opened.velocity).all()
    with pytest.raises(ValueError, match="checksum do not match"):
        opened.position.load()
    file.unlink()
    with pytest.raises(ValueError, match="see position/c/0/0/0/0/0/0: this concerns 1 of 4 members"):
        cs.open_sweep(path)


def test_a_kill_during_repair_passes_no_damage_on(sound, tmp_path, monkeypatch):
    """The members are pending on the disk before anything of them is replaced."""
    for name in ("energy_drift/zarr.json", "tip/c/0/0/0"):
        after, ended = 0, False
        while not ended:
            path = tmp_path / "s.zarr"
            shutil.copytree(sound[0], path)
            (path / name).unlink()
            with pytest.warns(RuntimeWarning, match="is damaged"):
                ended = not killed(monkeypatch, after, lambda: sweep(path))
            if not seen(path):
                opened = cs.open_sweep(path).load()
                for k in zip(*np.nonzero(opened.status.values), strict=True):
                    same(opened.isel(stiffness=k[0], springs=k[1]), sound[1].isel(stiffness=k[0], springs=k[1]))
            shutil.rmtree(path)
            after += 7


def test_the_store_of_a_single_run_is_repaired(tmp_path):
    def run():
        return cs.sweep(SCENE, duration=0.02, dt=1e-3, store=tmp_path / "s.zarr", progress=False).load()

    expected = run()
    (tmp_path / "s.zarr/stable/c").write_bytes(b"")
    with pytest.warns(RuntimeWarning, match="this concerns 1 of 1 members"):
        same(run(), expected)
    same(run(), expected)


def test_a_store_without_any_attributes_is_refused(sound, tmp_path):
    path = tmp_path / "s.zarr"
    shutil.copytree(sound[0], path)
    (path / "zarr.json").write_text("{}")
    (path / "sessions/c").unlink()
    for call in (cs.open_sweep, sweep):
        with pytest.raises(ValueError, match="no store of a sweep"):
            call(path)
