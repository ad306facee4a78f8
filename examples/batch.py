"""Step 500 cloths of different stiffness in one call."""

import clothsim as cs
import matplotlib.pyplot as plt
import numpy as np

base = cs.scenes.hanging(shape=(12, 12))
stiffness = np.geomspace(1e3, 1e5, 500)
scenes = [base.replace(cloth=base.cloth.replace(stiffness=k)) for k in stiffness]
x = np.stack([scene.initial_position for scene in scenes])
v = np.zeros_like(x)

x, v = cs.step(scenes, x, v, dt=2e-4, steps=500)
stretch = [100 * cs.largest_stretch(scene, end) for scene, end in zip(scenes, x)]
for k in (0, 249, 499):
    print(f"K = {stiffness[k]:8.0f} N/m: largest stretch {stretch[k]:.3f} %")

figure, axes = plt.subplots(figsize=(6, 4))
axes.loglog(stiffness, stretch)
axes.set(xlabel="stiffness [N/m]", ylabel="largest stretch at 0.1 s [%]")
figure.savefig("batch.png")
