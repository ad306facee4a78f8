"""A wheel does what the README shows, with NumPy alone: run it with the Python that the wheel is
installed in.
"""

import importlib.util
import os
import subprocess
import sys

PROGRAM = """
import clothsim as cs

cloth = cs.Cloth(shape=(32, 32), size=(1.0, 1.0), mass=512.0, stiffness=35_000.0, damping=100.0)
sphere = cs.Sphere(center=(0.5, -0.5, 0.5), radius=0.25, response="ray")
scene = cs.Scene(cloth, sphere)
run = cs.simulate(scene, duration=0.1, dt=1e-4, every=0.01)
assert run.x.shape == (11, 32, 32, 3), run.x.shape
assert run.report["instruction_set"] == "{isa}", run.report["instruction_set"]
x, v = cs.reference_step(scene, scene.initial_position, scene.initial_velocity, 1e-4, 1000)
deviation = abs(run.x[-1] - x).max()
assert deviation < 1e-11, deviation
print("{isa}", "deviation from the scalar reference", deviation)
"""

# Each of these brings an OpenMP runtime of its own.
BESIDE_OTHERS = """
import importlib
import numpy as np
for name in {modules}:
    importlib.import_module(name)
if "sklearn" in {modules}:
    from sklearn.cluster import KMeans
    KMeans(2, n_init=1).fit(np.random.default_rng(0).normal(size=(2000, 3)))
if "numba" in {modules}:
    import numba
    numba.set_num_threads(2)
    @numba.njit(parallel=True)
    def total(a):
        s = 0.0
        for i in numba.prange(len(a)):
            s += a[i]
        return s
    assert total(np.ones(10_000)) == 10_000
import clothsim as cs
scene = cs.scenes.paper_swing()
x, v = scene.initial_position, scene.initial_velocity
one, two = (cs.step(scene, x, v, 1e-4, 50, threads=n) for n in (1, 2))
assert (one[0] == two[0]).all()
np.linalg.eigvalsh(np.eye(300))
print("beside", {modules})
"""


def main() -> None:
    import clothsim as cs

    for isa in cs.build_config()["instruction_sets_supported"]:
        check(PROGRAM.replace("{isa}", isa), CLOTHSIM_ISA=isa)
    present = [name for name in ("numba", "sklearn") if importlib.util.find_spec(name)]
    check(BESIDE_OTHERS.replace("{modules}", repr(present)))


def check(program: str, **environment: str) -> None:
    subprocess.run([sys.executable, "-c", program], check=True, env={**os.environ, **environment})


if __name__ == "__main__":
    main()
