"""A flag in a wind with gusts, to an error that is asked for."""

import clothsim as cs
import numpy as np

GUSTS, FREQUENCY = np.array([1.5, 0.0, 2.3]), 1.2  # m/s, Hz

cloth = cs.Cloth(
    (20, 30),
    (1.0, 1.5),
    mass=0.2,
    stiffness=60.0,
    damping=0.02,
    pins=[(row, 0) for row in range(20)],
)
wind = cs.Wind((8.0, 0.0, 0.5), motion=cs.Sinusoid(GUSTS / (2 * np.pi * FREQUENCY), FREQUENCY))
upright = cloth.rest_positions[..., [0, 2, 1]] * (1, -1, 1)
run = cs.simulate(cs.Scene(cloth, position=upright, wind=wind), 1.2, rtol=1e-3, fps=40)
run.animate("flag.webp", fps=20, speed=0.5)
told, work = run.report["error_estimate"], run.report["wind_work"]
print("told error:", told["reason"] or f"{1000 * told['rms']:.1f} mm rms")
print(f"work of the wind: {work:.2f} J")
