"""Packages beyond NumPy: missed before any work is done, and the xarray accessor."""

import importlib
import sys

import clothsim as cs
import numpy as np
import pytest
from commands import python

SCENE = cs.scenes.oscillator()
RUN = cs.simulate(cs.Scene(cs.Cloth((3, 3))), 0.003, dt=1e-3, every=1)
MEASURED = (RUN.t[1:], np.zeros((3, 1, 2, 3)))
HINT = r"pip install 'clothsim\[{}\]'"


def refuse_import(*arguments, **options):
    raise AssertionError("something was computed before the package was missed")


@pytest.fixture
def nothing_runs(monkeypatch):
    for module, name in [
        ("stability.map", "is_stable"),
        ("accuracy.work", "checked_or_new_reference"),
        ("sweeps.sweep", "run_task"),
        ("engine.state", "State"),  # comes last, as the modules above take its name when imported
    ]:
        monkeypatch.setattr(importlib.import_module(f"clothsim.{module}"), name, refuse_import)


@pytest.mark.parametrize(
    ("package", "extra", "call"),
    [
        ("xarray", "sweep", lambda path: cs.stability_map(SCENE, [1e3], [1e-3], steps=1)),
        (
            "tqdm",
            "demo",
            lambda path: cs.stability_map(SCENE, [1e3], [1e-3], steps=1, progress=True),
        ),
        ("xarray", "sweep", lambda path: cs.work_precision(SCENE, 0.1)),
        ("tqdm", "demo", lambda path: cs.work_precision(SCENE, 0.1, progress=True)),
        ("xarray", "sweep", lambda path: cs.sweep(SCENE, {"dt": [1e-3]}, progress=False)),
        ("tqdm", "sweep", lambda path: cs.sweep(SCENE, {"dt": [1e-3]}, progress=True)),
        ("zarr", "sweep", lambda path: cs.sweep(SCENE, {"dt": [1e-3]}, store=path, progress=False)),
        ("zarr", "sweep", lambda path: cs.open_sweep(path)),
        ("tqdm", "demo", lambda path: cs.simulate(SCENE, 0.1, dt=1e-3, progress=True)),
        ("tqdm", "demo", lambda path: cs.fit(SCENE, *MEASURED, ["stiffness"], progress=True)),
        ("pxr", "export", lambda path: RUN.export(path / "a.usdc")),
        ("matplotlib", "plot", lambda path: RUN.plot()),
    ],
)
def test_a_missing_package_is_missed_before_the_work(
    package, extra, call, monkeypatch, nothing_runs, tmp_path
):
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"needs {package}: run {HINT.format(extra)}"):
        call(tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_accessor_comes_with_the_first_dataset():
    program = """
import sys, clothsim as cs
assert "xarray" not in sys.modules
data = cs.stability_map(cs.scenes.oscillator(), [1e3], [1e-3], steps=1)
assert callable(data.clothsim.plot) and "matplotlib" not in sys.modules
"""
    process = python(program, PYTHONWARNINGS="error")
    assert process.returncode == 0, process.stderr


def test_a_dataset_of_no_sweep_says_so():
    with pytest.raises(ValueError, match="lacks the attribute 'clothsim_sweep'"):
        cs.stability_map(SCENE, [1e3], [1e-3], steps=1).clothsim.provenance


def test_sweepable_names_have_units():
    names = cs.sweepable()
    assert (
        names["sphere_radius"] == "m"
        and names["damping_shear"] == "N s/m"
        and names["kernel"] == ""
    )
    with pytest.raises(ValueError, match=r"'stiffness'.*clothsim\.sweepable\(\) lists them"):
        cs.sweep(SCENE, {"stifness": [1.0]}, progress=False)
