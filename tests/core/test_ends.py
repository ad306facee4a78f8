"""Processes with few threads, and processes that end while the core works."""

import os
import sys

import pytest
from commands import python

_BEGIN = """
import os, resource, sys, threading, time, warnings
import clothsim as cs

scene = cs.scenes.paper_swing()
x, v = scene.initial_position, scene.initial_velocity
"""

_DAEMONS = """
large = cs.Scene(cs.Cloth((200, 200)))

def for_ever(call, *arguments):
    while True:
        call(*arguments)

calls = {
    "advance": (cs.Stepper(scene, threads=2).advance, 10**6, 1e-6),
    "simulate": (cs.simulate, scene, 10.0, 1e-5),
    "step": (for_ever, cs.step, scene, x, v, 1e-5, 20),
    "acceleration": (for_ever, cs.acceleration, large, large.initial_position, large.initial_velocity),
    "reference": (for_ever, cs.reference, scene, 1e-3),
}
call, *arguments = calls[sys.argv[1]]
for _ in range(1 if sys.argv[1] == "advance" else 3):
    threading.Thread(target=call, args=arguments, daemon=True).start()
time.sleep(0.3)
sys.exit(7)
"""

_LIMITED = """
one = cs.simulate(scene, 0.01, 1e-4, threads=1)
if sys.argv[1:]:
    if os.geteuid() == 0:
        os.setuid(65534)  # the limit holds for no root
    resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))
with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    for threads in (None, 2, 5):
        run = cs.simulate(scene, 0.01, 1e-4, threads=threads)
        assert (run.x == one.x).all() and (run.v == one.v).all(), threads
        limited = sys.argv[1:] or os.environ["OMP_STACKSIZE"] != "512k"
        assert run.report["threads"] == (1 if limited else threads or run.report["threads"])
        if not sys.argv[1:]:  # the limit allows no child
            child = os.fork()
            if child == 0:
                cs.step(scene, x, v, 1e-4, 20, threads=3)
                os._exit(0)
            assert os.waitpid(child, 0)[1] == 0
for warning in given:
    if issubclass(warning.category, RuntimeWarning):
        print(warning.message)
"""


@pytest.mark.parametrize("call", ["advance", "simulate", "step", "acceleration", "reference"])
def test_a_process_ends_with_its_own_code_while_daemon_threads_are_in_the_core(call):
    run = python(_BEGIN + _DAEMONS, call)
    assert run.returncode == 7, (run.returncode, run.stderr)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
@pytest.mark.parametrize(
    "arguments, environment", [(["limited"], {}), ([], {"OMP_STACKSIZE": "100G"}), ([], {"OMP_STACKSIZE": " 104857600 m "})]
)
def test_calls_go_on_with_the_threads_that_can_start(arguments, environment):
    run = python(_BEGIN + _LIMITED, *arguments, **environment)
    assert run.returncode == 0, run.stderr
    warnings = run.stdout.splitlines()
    if os.cpu_count() > 1:
        assert len(warnings) == 1 and warnings[0].startswith("threads: this process can start 1 of "), run.stdout


_USED_UP = """
if os.geteuid() == 0:
    os.setuid(65534)
resource.setrlimit(resource.RLIMIT_NPROC, (24, 24))
many = cs.Stepper([cs.Scene(cs.Cloth((6, 6)))] * 16, threads=8)
one = cs.Stepper(cs.Scene(cs.Cloth((100, 100))), threads=2)
many.advance(10, 1e-4)
one.advance(10, 1e-4)  # OpenMP ends the threads that the smaller team has left over
warnings.simplefilter("ignore")
held = threading.Event()
try:
    while True:
        threading.Thread(target=held.wait, daemon=True).start()
except RuntimeError:
    many.advance(10, 1e-4)
    cs.reference(scene, 0.01, threads=8, cache=False)
    sys.exit(7)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
def test_a_larger_team_than_the_last_may_find_no_more_threads(tmp_path):
    run = python(_BEGIN + _USED_UP, HOME=str(tmp_path))
    assert run.returncode == 7, (run.returncode, run.stderr)


@pytest.mark.unsanitized("thread", reason="TSan starts no thread after a fork of several threads")
def test_a_stack_size_that_fits_is_no_limit():
    run = python(_BEGIN + _LIMITED, OMP_STACKSIZE="512k")
    assert run.returncode == 0 and run.stdout == "", run.stdout + run.stderr
