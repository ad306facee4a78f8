"""Continuous contact on the adapter: the law of the core for one sphere."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.gpu import block
from clothsim.gpu import device as devices

DT = 4e-4


def ball(height=-0.29, **changes):
    return cs.Sphere((0.5, height, 0.5), 0.25, **changes)


def draped(*spheres, shape=(20, 20), **cloth):
    return cs.Scene(cs.Cloth(shape, **cloth), spheres)


def pair(scene, precision="single", steps=0, **options):
    """The core and the adapter, with the state of the core after some steps."""
    core = cs.Stepper(scene, precision=precision, kernel="gather", threads=1, t=0.0)
    core.advance(steps, DT)
    gpu = cs.Stepper(scene, core.positions, core.velocities, t=core.time, precision=precision, backend="gpu")
    core = cs.Stepper(scene, core.positions, core.velocities, t=core.time, precision=precision, kernel="gather")
    return core, gpu


def assert_same_bits(core, gpu):
    expected = core.snapshot().core
    for name, value in gpu.snapshot().core.items():
        assert np.asarray(value).tobytes() == np.asarray(expected[name]).tobytes(), name


RISING = cs.Linear((0.1, 0.5, 0.0))
SCENES = {
    "cell": draped(ball(), shape=(32, 32)),
    "cell, rough and rising": draped(ball(friction=0.3, motion=RISING), shape=(33, 17)),
    "cell, fast": draped(ball(motion=cs.Linear((0.1, 4.0, 0.0)), friction=0.1)),
    "cell, begins inside": draped(ball(-0.2)),
    "cell, a small sphere": draped(cs.Sphere((0.5, -0.06, 0.5), 0.04), shape=(16, 16)),
    "cell, mass per point": draped(ball(), shape=(10, 12), mass=np.linspace(0.5, 2.0, 120).reshape(10, 12)),
    "edge, rough": draped(ball(offset="edge", friction=0.2, motion=RISING)),
    "none": draped(ball(offset="none")),
    "a length": draped(ball(offset=0.01, motion=RISING)),
    "after ray": draped(ball(), cs.Sphere((0.9, -0.15, 0.6), 0.1, response="ray", motion=RISING)),
    "chain": draped(cs.Sphere((0.5, -0.29, 0.0), 0.25), shape=(1, 20), pins=((0, 0), (0, 19))),
    "column": draped(cs.Sphere((0.0, -0.29, 0.5), 0.25), shape=(20, 1), pins=((0, 0),)),
}


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("name", SCENES)
def test_the_bits_are_those_of_the_gather_kernel(name, precision, exact, device):
    if not (exact and device.float64):
        pytest.skip(f"{device.adapter.name} does not round as the core does")
    scene = SCENES[name]
    core, gpu = pair(scene, precision, 150)
    free = cs.Stepper(scene.replace(spheres=()), core.positions, core.velocities, t=core.time, precision=precision)
    for one in (core, gpu, free):
        one.advance(250, DT)
    assert_same_bits(core, gpu)
    assert np.abs(free.positions - core.positions).max() > 1e-3


def test_rounds_are_repeated_until_no_point_is_too_deep(exact, device, monkeypatch):
    """This impact needs three rounds and more: a run with one round alone is taken back."""
    if not (exact and device.float64):
        pytest.skip(f"{device.adapter.name} does not round as the core does")
    scene = SCENES["cell, fast"]
    core, gpu = pair(scene, steps=100)
    tried = []
    take = block.Block._run
    monkeypatch.setattr(block.Block, "_run", lambda self, steps: (tried.append(self._rounds), take(self, steps))[1])
    for one in (core, gpu):
        one.advance(300, DT)
    assert_same_bits(core, gpu)
    assert max(tried) >= 3
    monkeypatch.setattr(block, "MOST_ROUNDS", 1)
    _, other = pair(scene, steps=100)
    other.advance(300, DT)
    assert (other.positions != core.positions).any()


@pytest.mark.parametrize("offset", ["cell", "edge"])
def test_a_bounce_follows_the_core_but_for_the_energy_of_springs(offset):
    """The force of the step balances a bounce. The core takes the springs' energy, with neighbours that have responded."""
    core, gpu = pair(draped(ball(offset=offset, restitution=0.5)))
    for one in (core, gpu):
        one.advance(300, DT)
    free, still = (cs.Stepper(draped(*spheres), t=0.0, precision="single") for spheres in ((), (ball(offset=offset),)))
    for one in (free, still):
        one.advance(300, DT)
    deviation = np.abs(gpu.positions - core.positions)
    assert deviation.max() < 3e-4 and deviation.mean() < 3e-6
    assert np.abs(still.positions - core.positions).max() > 3e-3 and np.abs(free.positions - core.positions).max() > 1e-2
    assert cs.penetration(gpu.positions, ball(), gpu.time)["points"] == 0


@pytest.mark.filterwarnings("ignore::clothsim.ContactWarning")
@pytest.mark.parametrize("name", ["cell, rough and rising", "cell, begins inside", "edge, rough", "none"])
def test_without_float64_it_is_near_the_core_and_outside(name, device, monkeypatch):
    narrow = devices.Device(device.adapter, float64=False)
    monkeypatch.setattr(devices, "opened", lambda: narrow)
    scene = SCENES[name]
    core, gpu = pair(scene, steps=150)
    for one in (core, gpu):
        one.advance(250, DT)
    assert np.abs(gpu.positions - core.positions).max() < 5e-6
    assert np.abs(gpu.velocities - core.velocities).max() < 1e-3
    depths = cs.penetration(gpu.positions, scene.spheres[0], gpu.time)
    assert depths["triangles" if scene.spheres[0].offset == "cell" else "points"] == 0


@pytest.mark.parametrize(
    "scene, said",
    [
        (
            draped(cs.Sphere((0.2, -0.35, 0.2), 0.25, cs.Linear((-1.0, 1.5, -1.0)))),
            "a sphere has run into the pinned mass point",
        ),
        (draped(cs.Sphere((0.5, -0.05, 0.5), 0.03), shape=(9, 9)), "is larger than the sphere that it touches"),
    ],
)
def test_it_warns_as_the_core_does(scene, said):
    for backend in ("cpu", "gpu"):
        stepper = cs.Stepper(scene, t=0.0, precision="single", backend=backend)
        with pytest.warns(cs.ContactWarning, match=said):
            stepper.advance(500, DT)


def test_several_continuous_spheres_are_refused_by_name():
    with pytest.raises(ValueError, match=r"^response of at most one sphere can be 'continuous' .* got spheres \[0, 1\]"):
        cs.Stepper(draped(ball(), ball(-0.9)), precision="single", backend="gpu")
