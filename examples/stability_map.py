"""Stiffness against time step: which runs are stable, and where theory puts the limit."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np

scene = cs.scenes.hanging(shape=(8, 8))
data = cs.stability_map(
    scene, stiffness=np.geomspace(1e3, 1e5, 7), dt=np.geomspace(3e-4, 1e-2, 12), steps=300
)
agreement = float((data.stable == data.predicted).mean())
print(f"prediction and measurement agree in {100 * agreement:.0f} % of {data.stable.size} runs")

data.clothsim.plot()
plt.savefig("stability_map.png")
