"""A scene replaced in the middle of a run: the state and the clock stay."""

import threading

import clothsim as cs
import numpy as np
import pytest

CLOTH = cs.Cloth((8, 8), (1, 1), mass=0.3, stiffness=60.0, damping=0.02, pins=())
BALL = cs.Sphere((0.5, -0.3, 0.5), 0.25, response="ray", restitution=0.0, friction=0.3)
SCENE = cs.Scene(CLOTH, BALL)


def drape(scenes=SCENE, **options):
    """Return a sheet that lies on the ball."""
    stepper = cs.Stepper(scenes, **options)
    stepper.advance(1500, 2e-4)
    assert np.abs(stepper.impulses).max() > 0.01
    return stepper


def continued(stepper, steps=200):
    stepper.advance(steps, 2e-4)
    return stepper.positions, stepper.velocities


@pytest.mark.parametrize(
    "scenes", [SCENE, [SCENE, SCENE.replace(spheres=BALL.replace(center=(0.6, -0.4, 0.5)))]]
)
def test_the_scene_as_it_is_changes_no_bit_of_a_sheet_in_contact(scenes, precision, same_bits):
    stepper = drape(scenes, precision=precision)
    copy = cs.Stepper.restore(stepper.snapshot())
    copy.set_scene(scenes)
    assert copy.time == stepper.time
    assert same_bits(continued(copy), continued(stepper))


class Advancing:
    """Another thread that advances a stepper for as long as the block runs."""

    def __init__(self, stepper):
        self.stepper = stepper
        self.steps = 0
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.work)

    def work(self):
        while not self.stop.is_set():
            try:
                self.stepper.advance(20, 1e-4)
                self.steps += 20
            except RuntimeError:  # the other thread was quicker
                pass

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.stop.set()
        self.thread.join()


SHEET = cs.Scene(cs.Cloth((100, 100)))
CALLS = {
    "set_scene": lambda stepper: stepper.set_scene(SHEET),
    "set_state": lambda stepper: stepper.set_state(v=np.zeros((100, 100, 3))),
    "set_state of the clock": lambda stepper: stepper.set_state(t=-1.0),
    "set_force": lambda stepper: stepper.set_force(np.ones((100, 100, 3))),
    "freeze": lambda stepper: stepper.freeze(0),
    "advance": lambda stepper: stepper.advance(1, 1e-4),
    "positions": lambda stepper: stepper.positions,
    "snapshot": lambda stepper: stepper.snapshot(),
}


@pytest.mark.filterwarnings("ignore::clothsim.StabilityWarning")
@pytest.mark.parametrize("name", CALLS)
def test_beside_an_advance_of_another_thread_a_call_is_done_or_refused(name, same_bits):
    stepper = cs.Stepper(SHEET, threads=1)
    refused = successes = 0
    with Advancing(stepper) as advance:
        while refused < 3:
            try:
                CALLS[name](stepper)
                successes += 1
            except RuntimeError as error:
                assert (
                    str(error)
                    == "this state is being advanced by another thread; give each thread a "
                    "Stepper of its own"
                )
                refused += 1
    if name == "set_state of the clock":
        assert stepper.time < 0 if successes else round(stepper.time / 1e-4) == advance.steps
    elif name == "freeze":
        assert stepper.frozen.tolist() == [successes > 0]
    else:
        steps = advance.steps + (successes if name == "advance" else 0)
        assert round(stepper.time / 1e-4) == steps
        if not name.startswith("set_"):  # no step is half done
            fresh = cs.Stepper(SHEET, threads=1)
            fresh.advance(steps, 1e-4)
            assert same_bits((stepper.x, stepper.v), (fresh.x, fresh.v))
