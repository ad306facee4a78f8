"""Ctrl-C at every line of Python: the core and its record stay together."""

import os
import signal
import threading
import time

import clothsim as cs
import pytest


def test_ctrl_c_ends_the_reference():
    scene = cs.scenes.paper_swing()
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        cs.reference_step(scene, scene.initial_position, scene.initial_velocity, 1e-4, 20_000)
    timer.join()
    assert time.monotonic() - begin < 5  # 20,000 steps take half a minute
