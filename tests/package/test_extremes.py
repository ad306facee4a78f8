"""Odd uses of public objects: pickles, copies, callbacks that fail, imports without memory, odd environments."""

import copy
import sys

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.base.extras import needed
from commands import python

SCENE = cs.scenes.paper_moving()


def last_line(code, **environment):
    """That a new interpreter writes to either stream; it must not be killed."""
    run = python(code, **environment)
    assert run.returncode in (0, 1), run.stderr
    return (run.stdout + run.stderr).rstrip().rpartition("\n")[2]


# Pickles and copies


def test_pickles_of_a_stepper_and_of_the_core_are_refused_and_those_of_a_snapshot_pass():
    """In a new interpreter: the core's objects ended the process under protocols 0 and 1."""
    code = """
import clothsim as cs, pickle
stepper = cs.Stepper(cs.scenes.oscillator())
for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
    for one, words in ((stepper, "pickle stepper.snapshot()"), (stepper._state.core, "clothsim._core.Simulation")):
        try:
            pickle.dumps(one, protocol)
        except TypeError as error:
            assert words in str(error)
        else:
            raise AssertionError(protocol)
    assert cs.Stepper.restore(pickle.loads(pickle.dumps(stepper.snapshot(), protocol))).time == 0.0
print("all refused")
"""
    assert last_line(code) == "all refused"
    kinds = [value for value in vars(_core).values() if isinstance(value, type)]
    assert len(kinds) > 5 and all("__reduce_ex__" in vars(kind) for kind in kinds)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy])
def test_a_copy_of_a_stepper_has_its_own_state(copied, same_bits):
    one = cs.Stepper(SCENE, precision="single")
    one.advance(40, 1e-4)
    other = copied(one)
    assert other.time == one.time and same_bits([other.positions], [one.positions])
    one.advance(40, 1e-4)
    assert other.time == pytest.approx(4e-3)
    other.advance(40, 1e-4)
    assert same_bits([other.positions, other.velocities], [one.positions, one.velocities])


# Callbacks


@pytest.mark.parametrize("how", [{"dt": 1e-3, "fps": 500}, {"rtol": 1e-3, "fps": 500}, {"dt": 1e-3, "every": "step"}])
@pytest.mark.parametrize("error", [KeyError("mine"), MemoryError(), ValueError("mine"), StopIteration()])
def test_an_exception_of_a_callback_has_the_frames_so_far(how, error, same_bits):
    calls = []

    def callback(t, x, v):
        calls.append(t)
        if len(calls) == 4:
            raise error

    with pytest.raises(type(error)) as caught:
        cs.simulate(SCENE, 0.02, callback=callback, **how)
    run = caught.value.run
    assert caught.value is error and run.t.tolist() == calls
    assert run.report["stopped"] == "callback"
    stopped = cs.simulate(SCENE, 0.02, callback=lambda t, x, v: t >= calls[-1], **how)
    assert same_bits([run.x, run.v], [stopped.x, stopped.v])
    if "dt" in how:
        assert same_bits([run.resume(0.005).x[-1]], [stopped.resume(0.005).x[-1]])


def test_an_error_for_a_callbacks_wrong_result_holds_the_frames():
    with pytest.raises(TypeError, match="callback must return True") as caught:
        cs.simulate(SCENE, 0.02, dt=1e-3, callback=lambda t, x, v: "no")
    assert len(caught.value.run.t) == 1


def test_a_resumed_run_keeps_the_frames_as_well():
    def callback(t, x, v):
        if t > 0.01:
            raise KeyError

    with pytest.raises(KeyError) as caught:
        cs.simulate(SCENE, 0.01, dt=1e-3).resume(0.01, every=2, callback=callback)
    assert caught.value.run.t[0] == 0.01 and len(caught.value.run.t) == 2


def test_a_refused_argument_has_no_run():
    with pytest.raises(ValueError) as caught:
        cs.simulate(SCENE, -1.0, dt=1e-3)
    assert not hasattr(caught.value, "run")


def test_arrays_of_a_callback_cannot_be_made_writeable():
    seen = []

    def callback(t, x, v):
        seen.append((x, x.copy()))
        for array in (x, v):
            assert array.shape == (32, 32, 3) and array.dtype == np.float64
            while isinstance(array, np.ndarray):
                with pytest.raises(ValueError, match="WRITEABLE"):
                    array.flags.writeable = True
                array = array.base

    run = cs.simulate(SCENE, 0.01, dt=1e-3, every=2, callback=callback)
    assert all(np.array_equal(x, before) for x, before in seen)
    assert np.array_equal(run.x, [x for x, _ in seen])


# Packages


def test_an_import_that_fails_in_an_installed_package_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "without_memory.py").write_text("raise ImportError('failed to map segment from shared object')")
    (tmp_path / "without_part.py").write_text("import a_part_that_is_nowhere")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError, match=r"^this needs without_memory, which is installed .*: failed to map segment"):
        needed("without_memory", "this")
    with pytest.raises(ImportError, match=r"^this needs without_part, .*: No module named 'a_part_that_is_nowhere'"):
        needed("without_part", "this")
    with pytest.raises(ImportError, match=r"^this needs nowhere_at_all: run pip install"):
        needed("nowhere_at_all.part", "this")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of memory are those of Linux")
def test_too_little_memory_for_a_package_is_said():
    pytest.importorskip("xarray")
    limited = """
import resource, clothsim as cs
from clothsim.base.extras import needed
from commands import python
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {} * 2**20,) * 2)
try:
    needed("xarray", "this")
except (ImportError, MemoryError) as error:
    print(type(error).__name__, error)
else:
    print("loaded")
"""
    said = {last_line(limited.format(megabytes)) for megabytes in (2, 8)}
    assert said != {"loaded"} and not any("pip install" in one for one in said)


# The environment


@pytest.mark.parametrize(
    ("name", "shown"), [("garbage", "'garbage'"), ("x" * 100_000, f"'{'x' * 40}...'"), ("\udcff\x01a", "'??a'")]
)
def test_a_wrong_name_in_the_environment_is_shown_short(name, shown):
    last = last_line("import clothsim as cs; cs.Stepper(cs.scenes.paper_swing()).advance(1, 1e-4)", CLOTHSIM_ISA=name)
    assert last.startswith(f"ValueError: CLOTHSIM_ISA is {shown}; ") and len(last) < 150


def test_explain_names_the_fused_operations():
    config = cs.build_config()
    code = "import clothsim as cs; print(cs.scenes.paper_static().explain(strict={})['arithmetic'])"
    for name in config["instruction_sets_supported"]:
        fuses = "-mfma" in config["kernel_flags"][name] or name not in ("avx512", "avx2", "sse2")
        assert last_line(code.format(False), CLOTHSIM_ISA=name) == ("fused" if fuses else "not fused")
    assert last_line(code.format(True)) == "strict"
