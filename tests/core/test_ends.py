"""Processes that end while daemon threads are in the core."""

import pytest
from commands import python

_DAEMONS = """
import sys, threading, time
import clothsim as cs

scene = cs.scenes.paper_swing()
x, v = scene.initial_position, scene.initial_velocity
large = cs.Scene(cs.Cloth((200, 200)))

def for_ever(call, *arguments):
    while True:
        call(*arguments)

calls = {
    "advance": (cs.Stepper(scene, threads=2).advance, 10**9, 1e-6),  # ends late, unless the interpreter's lock is released
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


@pytest.mark.parametrize("call", ["advance", "simulate", "step", "acceleration", "reference"])
def test_a_process_ends_with_its_own_code_while_daemon_threads_are_in_the_core(call):
    run = python(_DAEMONS, call)
    assert run.returncode == 7, (run.returncode, run.stderr)
