"""Processes that end while daemon threads are in the core."""

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

for call in [
    # Ends late, unless the interpreter's lock is released.
    (cs.Stepper(scene, threads=2).advance, 10**9, 1e-6),
    (cs.simulate, scene, 10.0, 1e-5),
    (for_ever, cs.step, scene, x, v, 1e-5, 20),
    (for_ever, cs.acceleration, large, large.initial_position, large.initial_velocity),
    (for_ever, cs.reference, scene, 1e-3),
]:
    threading.Thread(target=call[0], args=call[1:], daemon=True).start()
time.sleep(0.3)
sys.exit(7)
"""


def test_a_process_ends_with_its_own_code_while_daemon_threads_are_in_the_core():
    run = python(_DAEMONS)
    assert run.returncode == 7, (run.returncode, run.stderr)
