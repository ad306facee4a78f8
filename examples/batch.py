"""Step 64 cloths of different stiffness in one call."""

import clothsim as cs
import numpy as np

base = cs.scenes.paper_swing()
scenes = [base.replace(cloth=base.cloth.replace(stiffness=k)) for k in np.geomspace(1e3, 1e5, 64)]
x = np.stack([scene.initial_position for scene in scenes])
v = np.zeros_like(x)

x, v = cs.step(scenes, x, v, dt=2e-4, steps=1500)
lowest = x[..., 1].min(axis=(1, 2))
print(f"lowest point after 0.3 s: {lowest[0]:.3f} m (softest) to {lowest[-1]:.3f} m (stiffest)")
