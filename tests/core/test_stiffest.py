"""What is stiffest of a cloth, against the spectrum of its tangent matrices."""

import clothsim as cs
import numpy as np
import pytest
from clothsim.runs import Options
from clothsim.stability.spectrum import tangent
from clothsim.stiffest import Stiffest

OPTIONS = Options("dop853", "double", 1, "auto", False)


def largest(product, scene):
    size = 3 * scene.cloth.pinned.size
    free = np.flatnonzero(np.repeat(~scene.cloth.pinned.ravel(), 3))
    matrix = product(np.eye(size)[free])[:, free]
    return np.abs(np.linalg.eigvals(matrix)).max()


@pytest.mark.parametrize("model, damping", [("spring", 0.5), ("point", 0.5), ("spring", 0.0)])
def test_the_fastest_and_the_most_damped_motion(model, damping):
    scene = cs.Scene(cs.Cloth(shape=(7, 9), mass=6.3, damping=damping, damping_model=model))
    x, v = scene.initial_position, scene.initial_velocity
    found = Stiffest(scene, OPTIONS)
    for _ in range(2):
        stiffness, damped = (largest(p, scene) for p in tangent(scene, x, v))
        assert 0.88 * stiffness**0.5 < found.omega < 1.001 * stiffness**0.5
        assert 0.8 * damped <= found.delta <= 1.001 * damped
        x, v = cs.step(scene, x, v, 1e-4, 2000)
        before = found.evaluations
        found.look(x, v)
        assert found.evaluations == before + 3


def test_a_cloth_that_nothing_moves():
    scene = cs.scenes.oscillator(damping=0.0)
    pinned = cs.Scene(scene.cloth.replace(pins=((0, 0), (0, 1))))
    found = Stiffest(pinned, OPTIONS)
    assert found.omega == 0 and found.limit("rk4") == np.inf
    assert Stiffest(scene, OPTIONS).limit("velocity_verlet") == pytest.approx(0.2)
