"""A method that docs/howto/add-an-integrator.md adds: everything is computed from its drifts and kicks."""

from commands import python

FOREST_RUTH = """
import math
import clothsim as cs
import numpy as np
from clothsim import _core
from clothsim.methods import integrators
from clothsim.methods.region import amplification_matrix

theta = 1 / (2 - 2 ** (1 / 3))
drifts, kicks = [theta / 2, (1 - theta) / 2, (1 - theta) / 2, theta / 2], [theta, 1 - 2 * theta, theta]
_core.add_splitting("forest_ruth", drifts, kicks)
integrators._PROPERTIES["forest_ruth"] = 4, 1, True
integrators.METHODS["forest_ruth"] = integrators._integrator("forest_ruth", _core.methods()["forest_ruth"])

method = cs.integrators()["forest_ruth"]
assert (method.family, method.stages, method.explicit, method.adaptive) == ("splitting", 3, True, False)
assert 1.5 < method.imaginary_limit < 1.6, method.imaginary_limit  # known: 1.5734
beyond = amplification_matrix("forest_ruth", method.imaginary_limit * 1.01, 0.0)
assert abs(np.linalg.eigvals(beyond)).max() > 1.001

scene = cs.scenes.oscillator(stiffness=100.0, mass=1.0, amplitude=0.1)
errors, counts = [], np.array([64, 96, 128])
for n in counts:
    x, _ = cs.step(scene, scene.initial_position, scene.initial_velocity, 1 / n, int(n), integrator="forest_ruth")
    errors.append(abs(x[0, 1, 0] - 1 - 0.1 * math.cos(10.0)))
order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
assert abs(order - 4) < 0.15, order

cloth = cs.scenes.paper_swing()
x = cloth.initial_position
assert 0 < cs.max_stable_dt(cloth, "forest_ruth") < cs.max_stable_dt(cloth, "forest_ruth", x)
assert cloth.explain(integrator="forest_ruth")["order"] == 1
run = cs.simulate(cloth, 0.01, integrator="forest_ruth", dt=1e-4)
assert run.report["integrator"] == "forest_ruth" and run.report["force_evaluations"] == 300
"""


def test_a_splitting_of_a_user_is_data_alone():
    """In a process of its own, because the method stays in the core."""
    done = python(FOREST_RUTH)
    assert done.returncode == 0, done.stderr
