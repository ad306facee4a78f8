"""Ctrl-C in the middle of a long step: the step is undone, and going on gives the bits of a run that was left alone."""

import os
import signal
import threading
import time

import clothsim as cs
import numpy as np
import pytest
from clothsim import _core
from clothsim.run.fixed_steps import RunOptions


def late(call, after):
    """Seconds from Ctrl-C, sent `after` seconds from now, to the KeyboardInterrupt out of the call."""
    sent = []

    def send():
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            call()
        return time.perf_counter() - sent[0]
    finally:
        timer.join()


def wrapped(points, gap=2e-3):
    """A sheet around the upper half of a sphere, which shrinks onto it: all triangles touch within the first step."""
    cloth = cs.Cloth((points, points), mass=1.0, stiffness=10.0, damping=0.0, pins=())
    place = cloth.rest_positions - cloth.rest_positions.mean(axis=(0, 1))
    length, radius = np.linalg.norm(place, axis=-1, keepdims=True), 0.45
    out = np.sin(length / radius) * place / np.maximum(length, 1e-300)
    out[..., 1] = np.cos(length[..., 0] / radius)
    ball = cs.Sphere((0, 0, 0), radius, None, "continuous", "face", restitution=0.0, friction=0.3)
    return cs.Scene(cloth, ball, position=(radius + gap) * out, velocity=-2.0 * out)


def batch():
    cloth = cs.Cloth((128, 128))
    return [cs.Scene(cloth, gravity=(0, 0, -float(k))) for k in range(1, 41)]


def state(stepper):
    return stepper.time, stepper.positions.tobytes(), stepper.velocities.tobytes()


SCENES = {"faces": lambda: wrapped(100), "batch": batch, "batch with faces": lambda: [wrapped(100)] * 3}


@pytest.mark.unsanitized("address", "thread", reason="measures time")
@pytest.mark.parametrize(("name", "threads"), [("faces", 1), ("batch", 1), ("batch", 2), ("batch with faces", 2)])
def test_ctrl_c_in_a_long_step_undoes_it(name, threads):
    scene = SCENES[name]()
    dt = 0.5 * cs.max_stable_dt(scene if isinstance(scene, cs.Scene) else scene[0])
    for _ in range(4):  # other processes may hold up a try
        stepper, whole = cs.Stepper(scene, threads=threads), cs.Stepper(scene, threads=threads)
        delay = late(lambda stepper=stepper: stepper.advance(100, dt), 0.03)
        taken = round(stepper.time / dt)  # a fast machine ends some steps of a batch before
        if taken:
            whole.advance(taken, dt)
        assert taken < 20 and state(stepper) == state(whole)
        if delay < 0.1:
            break
    assert delay < 0.1
    for each in (stepper, whole):
        each.advance(2, dt)
    assert state(stepper) == state(whole)


def test_ctrl_c_undoes_no_step_of_an_earlier_call():
    """The checkpoint is at the start; the two steps of earlier calls, without contact and quick, are done again."""
    scene, dt = wrapped(80, gap=5e-3), 1e-3
    whole, stepper = cs.Stepper(scene, threads=1), cs.Stepper(scene, threads=1)
    whole.advance(2, dt)
    for _ in range(2):
        stepper.advance(1, dt)
    late(lambda: stepper.advance(100, dt), 0.02)
    assert state(stepper) == state(whole)


def test_ctrl_c_in_a_search_for_a_free_place_ends_it():
    """Spheres that close upon a cloth trap it: a search of seconds ends with an error, unless Ctrl-C ends it first."""
    spheres = [
        cs.Sphere((0.47, s * (0.25 + 1e-4), 0.55), 0.25, cs.Linear((0, -2.0 * s, 0)), "continuous", "face", 1.0)
        for s in (1, -1)
    ]
    scene = cs.Scene(cs.Cloth((160, 160), mass=1.0, stiffness=10.0, damping=0.0, pins=()), spheres)
    dt = 0.5 * cs.max_stable_dt(scene)
    delays = []
    while not delays or (min(delays) > 0.1 and len(delays) < 4):
        stepper = cs.Stepper(scene)
        delays.append(late(lambda stepper=stepper: stepper.advance(100, dt), 0.4))
    assert min(delays) < 0.1


def test_ctrl_c_in_an_implicit_step_undoes_it():
    """Newton's method asks before each factorisation, of which the first step of a flat sheet takes dozens."""
    scene = cs.Scene(cs.Cloth((40, 40)))
    stepper, *wholes = (cs.Stepper(scene, integrator="implicit_midpoint", threads=1) for _ in range(3))
    seconds = []
    for whole in wholes:
        start = time.perf_counter()
        whole.advance(1, 5e-3)
        seconds.append(time.perf_counter() - start)
    late(lambda: stepper.advance(1, 5e-3), min(seconds) / 4)
    assert stepper.time == 0.0
    stepper.advance(1, 5e-3)
    assert state(stepper) == state(whole)


def test_ctrl_c_keeps_the_implicit_steps_before():
    stepper = cs.Stepper(cs.Scene(cs.Cloth((30, 30))), integrator="implicit_midpoint", threads=1)
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        while True:
            before = stepper.time
            stepper.advance(1000, 1e-3)
    timer.join()
    assert stepper.time > before


def test_ctrl_c_with_error_control_undoes_the_step_it_is_in():
    scene, options = wrapped(60), RunOptions("dop853", threads=1)
    ends = []
    for interrupted in (False, True):
        state, control = options.state(scene), _core.StepController()
        control.h = 1e-3

        def advance(steps, state=state, control=control):
            return state.core.advance_adaptive(1.0, 1.0, steps, 1e-4, 1e-2, 0.1, control, 1, False)

        start = time.perf_counter()
        advance(1)
        if interrupted:  # a quarter into the next step, which touches as much as the first
            delay = (time.perf_counter() - start) / 4
            timer = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            found = advance(1)
            timer.join()
            assert "interrupted" in found and found["steps"] == 0
        advance(2)
        x, v = np.empty((60, 60, 3)), np.empty((60, 60, 3))
        state.store(x, v)
        ends.append((state.core.time, x.tobytes(), v.tobytes(), control.state))
    assert ends[0] == ends[1]
