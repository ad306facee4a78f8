"""Step 64 cloths of different stiffness in one call."""

import clothsim as cs
import numpy as np

base = cs.scenes.hanging(shape=(16, 16))
stiffness = np.geomspace(1e3, 1e5, 64)
scenes = [base.replace(cloth=base.cloth.replace(stiffness=k)) for k in stiffness]
x = np.stack([scene.initial_position for scene in scenes])
v = np.zeros_like(x)

x, v = cs.step(scenes, x, v, dt=2e-4, steps=500)
for k in (0, 31, 63):
    stretch = cs.largest_stretch(scenes[k], x[k])
    print(f"K = {stiffness[k]:8.0f} N/m: largest stretch {100 * stretch:.3f} %")
