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

figure, axes = plt.subplots(figsize=(6, 4))
axes.pcolormesh(data.stiffness, data.dt, data.stable.T, cmap="Blues", vmax=2)
axes.loglog(data.stiffness, data.limit, "k-", label="predicted limit")
axes.loglog(data.stiffness, data.guarantee, "k--", label="guaranteed")
axes.set(xlabel="stiffness [N/m]", ylabel="time step [s]", title="blue: stable")
axes.legend()
figure.savefig("stability_map.png")
