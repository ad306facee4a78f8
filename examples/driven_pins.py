"""Shake a hanging cloth: motions drive the two pins of its upper side."""

import clothsim as cs
import numpy as np

shake = cs.Sinusoid((0.15, 0, 0), frequency=1.0)  # m along x, Hz
cloth = cs.Cloth(
    (20, 20), mass=0.2, stiffness=60.0, damping=0.02, pins={(0, 0): shake, (-1, 0): shake}
)
hanging = cloth.rest_positions[..., [1, 0, 2]] * (1, -1, 1)  # upright, in the plane x = 0
scene = cs.Scene(cloth, position=hanging)

run = cs.simulate(scene, 2.0, dt=1e-3, fps=25)
reach = np.ptp(run.x[:, -1, -1, 0])
print(f"the pins move by {2 * shake.amplitude[0]:.2f} m, a lower corner by {reach:.2f} m")
run.animate("driven_pins.webp", fps=25)
