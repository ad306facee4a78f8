"""Python calls between a user's call and the core's work: added checks or layers are seen here."""

import inspect
import pydoc
import sys
from concurrent.futures import Executor, Future

import clothsim as cs
import numpy as np
import pytest

FREE = cs.scenes.paper_swing()
BALL = FREE.replace(spheres=cs.Sphere((0.5, -0.6, 0.5), 0.2, response="ray", offset="edge"))
LAYER = FREE.replace(spheres=cs.Sphere((0.5, -0.6, 0.5), 0.2))
MOVING = FREE.replace(spheres=cs.Sphere((0.5, -0.6, 0.5), 0.2, cs.Linear((0.0, 0.1, 0.0))))


def calls(function):
    """List the Python functions that run in a second call: a first may build what is kept."""
    function()
    names = []
    sys.setprofile(
        lambda frame, event, argument: event == "call" and names.append(frame.f_code.co_name)
    )
    try:
        function()
    finally:
        sys.setprofile(None)
    return names[1:]


@pytest.mark.parametrize(
    "scene", [FREE, BALL, LAYER, MOVING], ids=["free", "ray", "layer", "moving"]
)
def test_a_warm_step(scene):
    x, v = scene.initial_position, scene.initial_velocity
    assert len(calls(lambda: cs.step(scene, x, v, 1e-4, t=0.0))) <= 12
    out = x.copy(), v.copy()
    assert len(calls(lambda: cs.step(scene, x, v, 1e-4, 2, 0.0, out=out))) <= 12


@pytest.mark.parametrize(
    "scene", [FREE, BALL, LAYER, cs.scenes.hanging()], ids=["swing", "ray", "layer", "hanging"]
)
def test_a_run(scene):
    assert len(calls(lambda: cs.simulate(scene, 0.2, rtol=1e-6))) <= 400
    count = len(calls(lambda: cs.simulate(scene, 0.2, dt=2e-4)))
    assert count <= 160
    # The number of steps adds no calls.
    assert len(calls(lambda: cs.simulate(scene, 2.0, dt=2e-4))) <= count + 2


class Inline(Executor):
    """An executor that runs a task when it is submitted, in this thread, where calls are seen."""

    _max_workers = 1

    def submit(self, function, *arguments, **options):
        future = Future()
        future.set_result(function(*arguments, **options))
        return future


def test_a_further_member_of_a_sweep():
    pytest.importorskip("xarray")

    def members(count):
        over = {"stiffness": np.linspace(1e3, 2e3, count)}
        options = {"duration": 0.002, "dt": 1e-4, "executor": Inline(), "progress": False}
        return len(calls(lambda: cs.sweep(BALL, over, **options)))

    members(128)  # This imports and caches.
    assert members(128) - members(64) <= 60 * 64


def test_help():
    assert len(pydoc.render_doc(cs.simulate, renderer=pydoc.plaintext).splitlines()) <= 75
    keys = cs.simulate(FREE, 0.01, dt=1e-3).report
    assert [key for key in keys if f'"{key}"' not in inspect.getdoc(cs.Run)] == []
