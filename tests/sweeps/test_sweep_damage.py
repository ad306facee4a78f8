"""Stores that are damaged: the array is named, and never handed on."""

import shutil

import clothsim as cs
import pytest

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from tests.sweeps.test_sweep_store import same

SCENE = cs.Scene(cs.Cloth((3, 3), mass=1.0, stiffness=50.0, damping=0.1))
OVER = {"stiffness": [50.0, 60.0], "springs": [("structural",), ("structural", "shear")]}


def tip(run):
    return run.x[-1, -1, -1]


def sweep(path, over=OVER):
    metrics = ["stable", "energy_drift", tip]
    return cs.sweep(
        SCENE, over, duration=0.02, dt=1e-3, store=path, progress=False, metrics=metrics
    )


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Return the folder of a store, and what is in it."""
    path = tmp_path_factory.mktemp("store") / "s.zarr"
    return path, sweep(path)


def flipped(data):
    place = len(data) // 2
    return data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :]


def chunks(path):
    return sorted(
        file.relative_to(path).as_posix() for file in path.glob("*/c/**/*") if file.is_file()
    )


DAMAGES = {
    "flipped": flipped,
    "cut": lambda data: data[:-1],
    "empty": lambda data: b"",
    "missing": None,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_chunk_is_refused_and_its_array_named(sound, tmp_path, damage):
    names = chunks(sound[0])
    assert len(names) == 2 + 6 + 3
    for name in names:
        path = tmp_path / "s.zarr"
        shutil.copytree(sound[0], path)
        data = (path / name).read_bytes()
        (path / name).unlink()
        if damage is not None:
            (path / name).write_bytes(damage(data))
        if name == "status/c/0/0" and damage is None:  # these members are pending
            same(sweep(path), sound[1])
        else:
            for call in (cs.open_sweep, sweep)[: 2 if name.startswith("stable") else 1]:
                with pytest.raises(
                    ValueError, match=rf"is damaged at {name.split('/')[0]} \(.*\): delete it"
                ):
                    call(path)
        shutil.rmtree(path)


def test_the_store_of_a_single_run_is_read_whole_or_not(tmp_path):
    path = tmp_path / "s.zarr"
    expected = sweep(path, None)
    same(cs.open_sweep(path), expected)
    (path / "stable/c").write_bytes(b"")
    for call in (cs.open_sweep, lambda path: sweep(path, None)):
        with pytest.raises(ValueError, match="is damaged at stable "):
            call(path)


def test_a_store_without_its_attributes_or_an_array_is_refused(sound, tmp_path):
    path = tmp_path / "s.zarr"
    shutil.copytree(sound[0], path)
    shutil.rmtree(path / "energy_drift")
    with pytest.raises(ValueError, match=r"is damaged at energy_drift \(KeyError: .*\): delete it"):
        sweep(path)
    (path / "zarr.json").write_text("{}")
    for call in (cs.open_sweep, sweep):
        with pytest.raises(ValueError, match="no store of a sweep"):
            call(path)
