"""How the package was built, which instruction set it takes, and what an import loads."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import clothsim as cs
import pytest
from clothsim import _core
from commands import python
from tables import each

EXTRAS = ("matplotlib", "tqdm", "xarray", "scipy", "zarr", "dask", "wgpu", "PIL", "pandas", "pxr")


def printed(code, **environment):
    run = python(code, **environment)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_import_loads_numpy_and_light_parts_of_the_standard_library():
    """An import takes as long as what it loads; these take longest of all that come with Python."""
    code = (
        "import sys, numpy; before = set(sys.modules); import clothsim; "
        "print(*sorted(set(sys.modules) - before))"
    )
    roots = {name.partition(".")[0] for name in printed(code).split()}
    assert roots - {"clothsim", "numpy"} <= sys.stdlib_module_names
    heavy = {
        "asyncio",
        "concurrent",
        "email",
        "http",
        "multiprocessing",
        "socket",
        "sqlite3",
        "ssl",
        "unittest",
        "xml",
    }
    assert not roots & heavy


def test_stepping_needs_numpy_alone():
    code = f"""
import sys
for extra in {EXTRAS!r}:
    sys.modules[extra] = None
import clothsim as cs
run = cs.simulate(cs.scenes.paper_static(), 0.01, dt=1e-3, every=2)
cs.Stepper(cs.scenes.paper_moving()).advance(5, 1e-4)
print(run.report["steps"])
"""
    assert printed(code) == "10\n"


def test_build_config(monkeypatch):
    monkeypatch.delenv("CLOTHSIM_ISA", raising=False)
    config = cs.build_config()
    assert config["version"] == cs.__version__
    assert config["instruction_sets_built"] in (["avx512", "avx2", "sse2"], ["portable"])
    assert set(config["instruction_sets_supported"]) <= set(config["instruction_sets_built"])
    assert config["instruction_sets_built"][-1] in config["instruction_sets_supported"]
    assert config["instruction_set"] == config["instruction_sets_supported"][0]
    assert config["threads"] >= 1
    assert config["openmp"] is None or re.fullmatch(r"lib\w+, OpenMP \d\.\d", config["openmp"])
    for name in ("eigen", "xsimd", "python"):
        assert all(part.isdigit() for part in config[name].split(".")[:2])
    assert "-ffast-math" not in config["flags"] and "-ffp-contract=off" in config["flags"]
    assert set(config["kernel_flags"]) == set(config["instruction_sets_built"])
    assert config["compiler"] and config["build_type"]


def test_the_environment_overrides_it(monkeypatch):
    scene = cs.scenes.paper_swing()
    for name in cs.build_config()["instruction_sets_supported"]:
        monkeypatch.setenv("CLOTHSIM_ISA", name)
        assert cs.build_config()["instruction_set"] == name
        assert cs.Stepper(scene)._state.instruction_set == name
        assert scene.explain()["instruction_set"] == name


def test_a_wrong_instruction_set_is_an_error_that_lists_the_right_ones(monkeypatch):
    scene = cs.scenes.paper_swing()
    supported = ", ".join(cs.build_config()["instruction_sets_supported"])
    monkeypatch.setenv("CLOTHSIM_ISA", "neon")
    for call in (cs.build_config, lambda: cs.Stepper(scene), scene.explain):
        with pytest.raises(ValueError, match=f"CLOTHSIM_ISA is 'neon'.*{supported}"):
            call()


def test_explain_adds_up():
    scene = cs.scenes.paper_static(bend=True)
    account = scene.explain()
    assert account["springs"] == 5826 and account["mass_points"] == 1024
    assert "bend springs" in account["computed"] and "spheres" in account["computed"]
    less = cs.scenes.paper_swing().explain()
    assert "bend springs" in less["left_out"] and "spheres" in less["left_out"]
    assert set(account["computed"]) & set(account["left_out"]) == set()
    assert "instruction set" in str(account)
    assert scene.explain(kernel="gather")["kernel"] == "gather"


def _objects():
    """Return the kernels' object files, where this is a build tree."""
    root = Path(__file__).parents[2] / "build"
    return sorted(root.glob("*/CMakeFiles/clothsim_kernels_*.dir/**/*.o"))


@pytest.mark.skipif(not _objects() or not shutil.which("nm"), reason="no build tree or no nm here")
@each("path", _objects() or [None])
def test_kernel_objects_have_no_function_in_common(path):
    """A weak symbol compiled with AVX-512 could be picked by the linker for every processor."""
    symbols = subprocess.run(["nm", "-C", path], capture_output=True, text=True).stdout.splitlines()
    shared = [s for s in symbols if s[17:18] in "WVui" and s[17:18].strip()]
    assert not [s for s in shared if "__gxx_personality" not in s and s[17] != "w"], shared
    exported = [s for s in symbols if s[17:18] in "TDRB"]
    table = path.name.partition(".")[0].title().replace("_", "") + "Of"
    assert len(exported) == 1 and f"clothsim::{table}<" in exported[0], exported


def test_the_module_exports_only_its_entry_point():
    if not shutil.which("nm"):
        pytest.skip("no nm here")
    run = subprocess.run(
        ["nm", "-CD", "--defined-only", _core.__file__], capture_output=True, text=True
    )
    names = [line.split(maxsplit=2)[2] for line in run.stdout.splitlines()]
    assert [n for n in names if "clothsim" in n] == []
    assert "PyInit__core" in names


def test_an_import_without_the_core_says_how_to_build_it(tmp_path):
    package = Path(cs.__file__).parent
    shutil.copytree(
        package, tmp_path / "clothsim", ignore=shutil.ignore_patterns("_core*", "__pycache__")
    )
    code = "try:\n    import clothsim\nexcept ImportError as error:\n    print(error)"
    message = printed(code, PYTHONPATH=str(tmp_path))
    assert message.startswith(
        "the core of clothsim is not built here: run `pip install .` in the clone"
    )
