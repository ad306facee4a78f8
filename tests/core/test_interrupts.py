"""Ctrl-C at every line of Python: the core and its record stay together."""

import os
import signal
import sys
import threading
import time

import clothsim as cs
import numpy as np
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


BALLS = [cs.Sphere((0.3, -0.4, 0.3), 0.1), cs.Sphere((0.7, -0.4, 0.7), 0.1)]
SCENE = cs.Scene(cs.Cloth((5, 5), mass=1.0, stiffness=50.0, damping=0.1), BALLS)
HEAVY = SCENE.replace(gravity=(1.0, -20.0, 0.0), spheres=BALLS[:1])
FORCE = np.full((5, 5, 3), 0.3)
PACKAGE = os.path.dirname(cs.__file__)


def interrupted_at(line, call):
    """Make a call with Ctrl-C at the given line of the package that it reaches; False behind it."""
    count = 0

    def trace(frame, event, argument):
        nonlocal count
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            count += 1
            if count == line:
                signal.raise_signal(signal.SIGINT)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        pass
    finally:
        sys.settrace(before)
    return count >= line


def agrees(stepper):
    """Whether the core does what the stepper's scene says."""
    fresh = cs.Stepper(stepper.scene, stepper.x, stepper.v, t=stepper.t)
    for sheet in (stepper, fresh):
        sheet.advance(40, 5e-3)
    return np.abs(stepper.x - fresh.x).max() < 1e-12


@pytest.mark.parametrize(
    "call",
    [
        lambda stepper: stepper.advance(8, 1e-3, centers={0: (0.3, -0.1, 0.3), 1: (0.7, 0.1, 0.7)}),
        lambda stepper: stepper.set_scene(HEAVY),
        lambda stepper: stepper.set_force(FORCE),
    ],
    ids=["centers", "scene", "force"],
)
def test_ctrl_c_at_any_line_leaves_core_and_scene_together(call):
    call(cs.Stepper(SCENE))  # what is kept on the scenes is made, so that all calls are alike
    line = 1
    agreements = []
    while True:
        stepper = cs.Stepper(SCENE)
        if not interrupted_at(line, lambda stepper=stepper: call(stepper)):
            break
        agreements.append(agrees(stepper))
        line += 1
    assert line > 20 and all(agreements)


def test_a_refused_centre_leaves_every_sphere_where_it_is():
    stepper = cs.Stepper(SCENE)
    with pytest.raises(ValueError, match=r"centers\[1\] must be reached at a finite speed"):
        stepper.advance(1, 1e-3, centers={0: (5, 5, 5), 1: (1e308, 0, 0)})
    assert stepper.scene == SCENE and agrees(stepper)


def test_ctrl_c_ends_a_long_advance_with_centres():
    stepper = cs.Stepper(SCENE)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        stepper.advance(10**8, 1e-6, centers={0: (0.3, -0.2, 0.3)})
    timer.join()
    assert 0 < stepper.t < 50 and agrees(stepper)
