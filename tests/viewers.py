"""The live viewer in tests: a port of its own, and waiting for what its threads do."""

import socket
import time

import clothsim as cs


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def view(**options):
    return cs.view(cs.scenes.paper_static(), block=False, dt=2e-4, port=free_port(), **options)


def wait_for(condition, what="the condition", seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what} did not come true in {seconds:g} s"
        time.sleep(0.01)
