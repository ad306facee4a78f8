"""Sweep the stiffness and the time step: which runs hold, and how much energy they lose."""

import clothsim as cs
import matplotlib.pyplot as plt

scene = cs.scenes.hanging(shape=(12, 12))
table = cs.sweep(
    scene,
    over={"stiffness": [1e3, 1e4, 1e5], "dt": [1e-4, 1e-3, 1e-2]},
    duration=0.2,
    metrics=("stable", "energy_drift"),
    progress=False,
)
print(table["stable"].to_pandas())
print(table["energy_drift"].to_pandas())
table.clothsim.plot("stability")
plt.savefig("sweep_stiffness_and_step.png")
