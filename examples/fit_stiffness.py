"""Fit the stiffness of a cloth to a measured motion with SciPy."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

TIMES = np.linspace(0.05, 0.5, 10)
base = cs.scenes.hanging(shape=(12, 12))


def heights(stiffness):
    """Height of a corner of the cloth at TIMES [m]."""
    scene = base.replace(cloth=base.cloth.replace(stiffness=float(stiffness)))
    return cs.simulate(scene, 0.5, dt=2e-4, times=TIMES).x[1:, -1, -1, 1]


noise = np.random.default_rng(0).normal(0, 1e-3, TIMES.size)  # a tracker's error: 1 mm
measured = heights(2_000.0) + noise
found = least_squares(lambda log_k: heights(10 ** log_k[0]) - measured, x0=[3.7], diff_step=1e-3)
stiffness = 10 ** found.x[0]
deviation = np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[0, 0]) * 1e-3 * np.log(10)
print(f"stiffness {stiffness:.0f} +- {stiffness * deviation:.0f} N/m after {found.nfev} runs; the true one is 2000 N/m")

figure, axes = plt.subplots(figsize=(6, 4))
axes.plot(TIMES, measured, "ko", label="measured")
axes.plot(TIMES, heights(stiffness), label=f"fitted, {stiffness:.0f} N/m")
axes.set(xlabel="time [s]", ylabel="height of the corner [m]")
axes.legend()
figure.savefig("fit_stiffness.png")
